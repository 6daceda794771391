// Two columns of a study against each other, coloured by a third, and the front: what no other one beats in both.
"use strict";
{
  const { columns, shown } = JSON.parse(document.getElementById("study-data").textContent);
  const names = Object.keys(columns), get = (id) => document.getElementById(id), column = (way) => columns[get(way).value];
  const ticks = ({ labels }) => labels && { tickvals: labels.map((_, i) => i), ticktext: labels };
  const axis = (own) => ({ title: { text: own.words }, type: own.log ? "log" : "linear", automargin: true, ...ticks(own) });
  const told = ({ words, labels, values }, i) => `${words}: ${labels ? labels[values[i]] : values[i] ?? "–"}`;
  const text = columns.rms_deg.values.map((_, i) => names.map((name) => told(columns[name], i)).join("<br>"));

  function front(x, y) {
    const [sx, sy] = ["dx", "dy"].map((way) => (get(way).value === "less" ? 1 : -1));
    const order = text.map((_, i) => i).filter((i) => x.values[i] !== null && y.values[i] !== null);
    order.sort((a, b) => sx * (x.values[a] - x.values[b]) || sy * (y.values[a] - y.values[b]));
    let best = Infinity;
    return order.filter((i) => { const on = sy * y.values[i] < best; if (on) best = sy * y.values[i]; return on; });
  }
  function draw() {
    const [x, y, z] = ["x", "y", "z"].map(column), best = front(x, y);
    const colorbar = { title: { text: z.words, side: "top" }, orientation: "h", thickness: 12, y: 1, yanchor: "bottom", ...ticks(z) };
    const marker = { color: z.values, colorscale: "Cividis", size: 6, colorbar, ...(z.labels && { cmin: -0.5, cmax: z.labels.length - 0.5 }) };
    const ends = Object.fromEntries(Object.entries({ x, y }).map(([way, own]) => [way, best.map((i) => own.values[i])]));
    Plotly.react("designs", [
      { x: x.values, y: y.values, text, hoverinfo: "text", mode: "markers", marker },
      { ...ends, hoverinfo: "skip", mode: "lines+markers", line: { color: "#D55E00" }, marker: { symbol: "circle-open", size: 11 } },
    ], { xaxis: axis(x), yaxis: axis(y), height: 520, margin: { l: 20, r: 10, t: 10, b: 20 }, showlegend: false, hovermode: "closest" }, { displaylogo: false, responsive: true });
    get("said").textContent = `${best.length} of ${text.length} are on the front; point at one to read it.`;
  }
  for (const [way, wanted] of Object.entries(shown)) {
    names.forEach((name) => get(way).append(new Option(columns[name].words, name, false, name === wanted)));
    const better = get(`d${way}`), turned = () => { if (better) better.value = column(way).more ? "more" : "less"; };
    if (better) for (const word of ["less", "more"]) better.append(new Option(`${word} is better`, word));
    if (better) better.addEventListener("change", draw);
    get(way).addEventListener("change", () => { turned(); draw(); }); turned();
  }
  draw();
}
