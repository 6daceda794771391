"use strict";
(() => {
  const data = JSON.parse(document.getElementById("study-data").textContent);
  const { node, short, frame } = chart, names = Object.keys(data.columns);
  const get = (id) => document.getElementById(id);

  /* a column as numbers: texts and choices by their index, a logarithmic one by its logarithm */
  function column(name) {
    const given = data.columns[name], told = given.labels;
    const values = given.log ? given.values.map((v) => v === null ? null : Math.log10(v)) : given.values;
    let low = Infinity, high = -Infinity;
    for (const v of values) if (v !== null) { low = Math.min(low, v); high = Math.max(high, v); }
    if (!(low < high)) { const room = Math.abs(low) || 1; low -= room / 2; high += room / 2; }
    const room = told ? 0.5 : 0.03 * (high - low);
    return { name, values, labels: told, words: given.words, low: low - room, high: high + room, log: given.log };
  }

  function front(x, y, lessX, lessY) {
    const sx = lessX ? 1 : -1, sy = lessY ? 1 : -1, order = [];
    x.values.forEach((v, i) => { if (v !== null && y.values[i] !== null) order.push(i); });
    order.sort((a, b) => sx * (x.values[a] - x.values[b]) || sy * (y.values[a] - y.values[b]));
    let best = Infinity;
    return order.filter((i) => { const v = sy * y.values[i], on = v < best; if (on) best = v; return on; });
  }

  function said(i) {
    return names.map((name) => {
      const own = data.columns[name], v = own.values[i];
      return `${own.words}: ${v === null ? "–" : own.labels ? own.labels[v] : short(v)}`;
    }).join("\n");
  }

  function pareto() {
    const x = column(get("pareto-x").value), y = column(get("pareto-y").value);
    const [px, py] = frame(get("pareto"), x, y), svg = get("pareto");
    x.values.forEach((v, i) => {
      if (v === null || y.values[i] === null) return;
      const dot = node("circle", { cx: px(v), cy: py(y.values[i]), r: 2.5, class: "dot" });
      dot.append(node("title", {}, said(i)));
      svg.append(dot);
    });
    const best = front(x, y, get("pareto-dx").value === "less", get("pareto-dy").value === "less");
    svg.append(node("polyline", { points: best.map((i) => `${px(x.values[i])},${py(y.values[i])}`).join(" "), class: "front" }));
    for (const i of best) {
      const dot = node("circle", { cx: px(x.values[i]), cy: py(y.values[i]), r: 5, class: "best", tabindex: 0 });
      dot.append(node("title", {}, said(i)));
      svg.append(dot);
    }
    get("pareto-said").textContent = `${best.length} of ${x.values.length} are on the front; point at one to read it.`;
  }

  function mix(share) {
    const from = [238, 241, 244], to = [0, 114, 178];
    return `rgb(${from.map((v, k) => Math.round(v + share * (to[k] - v))).join(",")})`;
  }

  function map() {
    const x = column(get("map-x").value), y = column(get("map-y").value), z = data.columns[get("map-z").value];
    const svg = get("map"), [px, py] = frame(svg, x, y), cells = new Map();
    const count = (axis) => axis.labels ? axis.labels.length : data.cells;
    const place = (axis, v) => axis.labels ? v : Math.min(count(axis) - 1,
      Math.floor((v - axis.low) / (axis.high - axis.low) * count(axis)));
    x.values.forEach((v, i) => {
      if (v === null || y.values[i] === null || z.values[i] === null) return;
      const key = place(x, v) + count(x) * place(y, y.values[i]), cell = cells.get(key) || [0, 0];
      cells.set(key, [cell[0] + z.values[i], cell[1] + 1]);
    });
    const means = [...cells.values()].map(([sum, n]) => sum / n), low = Math.min(...means), high = Math.max(...means);
    for (const [key, [sum, n]] of cells) {
      const i = key % count(x), j = Math.floor(key / count(x)), mean = sum / n, share = high > low ? (mean - low) / (high - low) : 0;
      const edge = (axis, k) => axis.low + k * (axis.high - axis.low) / count(axis);
      const box = node("rect", { x: px(edge(x, i)), y: py(edge(y, j + 1)), width: px(edge(x, i + 1)) - px(edge(x, i)) - 1,
        height: py(edge(y, j)) - py(edge(y, j + 1)) - 1, fill: mix(share) });
      box.append(node("title", {}, `${z.words}: ${short(mean)} (mean of ${n})`));
      svg.append(box);
      svg.append(node("text", { x: px(edge(x, i + 0.5)), y: py(edge(y, j + 0.5)) + 4, "text-anchor": "middle",
        class: share > 0.55 ? "light" : "cell" }, short(mean)));
    }
    get("map-said").textContent = `Mean ${z.words} in each part; darker is larger.`;
  }

  function trace(at) {
    const one = data.cases[at], svg = get(`case-${at}`);
    const edge = one.estimate.map((v, i) => [v - one.half[i], v + one.half[i]]);
    const all = [...one.truth, ...edge.flat()], low = Math.min(...all), high = Math.max(...all);
    const room = 0.05 * (high - low) || 1;
    const [px, py] = frame(svg, { low: one.time[0], high: one.time[one.time.length - 1], words: "time [s]" },
      { low: low - room, high: high + room, words: "angle [°]" });
    const line = (values) => values.map((v, i) => `${px(one.time[i]).toFixed(1)},${py(v).toFixed(1)}`);
    svg.append(node("polygon", { points: [...line(edge.map((e) => e[0])), ...line(edge.map((e) => e[1])).reverse()].join(" "), class: "band" }));
    svg.append(node("polyline", { points: line(one.truth).join(" "), class: "truth" }));
    svg.append(node("polyline", { points: line(one.estimate).join(" "), class: "estimate" }));
  }

  function fill(id, wanted, draw) {
    const select = get(id);
    for (const name of names) select.append(new Option(data.columns[name].words, name, false, name === wanted));
    select.addEventListener("change", draw);
  }

  const direction = (axis) => () => { get(`pareto-d${axis}`).value = data.columns[get(`pareto-${axis}`).value].more ? "more" : "less"; pareto(); };
  if (names.length > 1) {
    fill("pareto-x", data.pareto[0], direction("x"));
    fill("pareto-y", data.pareto[1], direction("y"));
    for (const axis of ["x", "y"]) get(`pareto-d${axis}`).addEventListener("change", pareto);
    for (const [k, axis] of ["x", "y", "z"].entries()) fill(`map-${axis}`, data.map[k], map);
    direction("x")(); direction("y")(); map();
  }
  data.cases.forEach((_, at) => trace(at));
  document.body.dataset.drawn = "yes";
})();
