// The lab: plant and filters of a rig run as WebAssembly, sliders change what is true, curves show what is said of it.
"use strict";
(async () => {
  const by = (id) => document.getElementById(id);
  const data = JSON.parse(by("lab-data").textContent), lab = by("lab"), DEGREE = Math.PI / 180;
  const bytes = Uint8Array.from(atob(data.code), (c) => c.charCodeAt(0));
  const { instance } = await WebAssembly.instantiate(bytes, {});
  const wasm = instance.exports;
  if (wasm._initialize) wasm._initialize();
  const view = (name, count, Kind = Float64Array) => new Kind(wasm.memory.buffer, wasm[name](), count);
  const { bodies, joints: names, sensors, interval } = data, nj = names.length;
  const numbers = view("lab_numbers", data.numbers), truth = view("lab_truth", 3 * bodies + data.tendons.length);
  const values = view("lab_values", sensors.length), dead = view("lab_dead", sensors.length, Uint8Array);
  const told = view("lab_told", data.told.length), pull = view("lab_pull", 5 * bodies);
  const part = (k) => pull.subarray(k * bodies, (k + 1) * bodies);
  const free = data.commanded, commanded = free.length ? view("lab_commanded", bodies - nj) : null;
  const aims = free.length ? view("lab_desired", free.length) : [], brings = () => free.length > 0 && by("bring").checked;
  const [effort, , stiffness, target, damping] = [0, 1, 2, 3, 4].map(part);
  const at = (name) => data.told.indexOf(name), tensionsAt = 2 * bodies;

  // what is kept of each sample: time, true angles, angles and stds told, inextensible angles, torques true and told
  const torques = data.torques.map(([value, std, joint]) => [at(value), at(std), joint]);
  const width = 1 + 4 * nj + 3 * torques.length, KEPT = Math.ceil(data.window / interval);
  const kept = new Float64Array(width * KEPT), readings = [], { most } = data.shape;
  let count = 0, nominal = null, hand = null, playing = true, joint = nj - 1, loaded = joint, frames = 0, broken = false;

  const settings = Object.fromEntries([...lab.querySelectorAll("input[type=range]")].map((input) => [input.name, input]));
  const setting = (name) => (settings[name].dataset.log !== undefined ? 2 ** Number(settings[name].value) : Number(settings[name].value));
  const said = (name) => { const x = setting(name), unit = settings[name].dataset.unit; return unit === "×" ? `${x.toFixed(x < 2 ? 2 : 1)} ×` : `${+x.toPrecision(2)} ${unit}`; };

  // x(θ) of the drives: what stands still at each joint's angle, added up over the joints
  function places(angles) {
    const found = [...data.start];
    angles.forEach((angle, j) => {
      const table = data.positions[j], k = ((angle - table.from) / (table.to - table.from)) * (table.rows.length - 1);
      const i = Math.min(Math.max(Math.floor(k), 0), table.rows.length - 2);
      for (let d = 0; d < bodies - nj; d++) found[nj + d] += table.rows[i][d] + (k - i) * (table.rows[i + 1][d] - table.rows[i][d]);
    });
    return found;
  }
  // where the motors lead the joints
  function led(time, range, speed) {
    const ramp = Math.min(time / 2, 1);
    return data.motion.map((m) => m.from + ramp * (m.centre - m.from + range * m.amplitude * Math.sin(2 * Math.PI * speed * m.pace * time)));
  }
  // the inverse brings the joint in the curves to the desired angle, the others where they are led
  function aim(way) {
    free.forEach((j, i) => { aims[i] = brings() && j === joint ? data.motion[j].centre + setting("desired") * DEGREE : way[j]; });
  }
  function act(time) {
    const way = led(time, setting("range"), setting("speed")), tight = setting("pretension");
    aim(way);
    const wanted = brings() ? [...data.start.slice(0, nj), ...Array.from(commanded, (place, d) => place - data.zeros[d])] : places(way);
    for (let i = nj; i < bodies; i++) {
      effort[i] = data.effort[i] * tight; stiffness[i] = data.servo[i - nj][0]; damping[i] = data.servo[i - nj][1]; target[i] = wanted[i];
    }
    for (let j = 0; j < nj; j++) {
      const held = hand && hand.joint === j;
      effort[j] = j === loaded ? setting("load") : 0;
      stiffness[j] = held ? data.hand[0] : 0; damping[j] = held ? data.hand[1] : 0; target[j] = held ? hand.angle : 0;
    }
    for (const [name, indices] of Object.entries(data.factors)) for (const i of indices) numbers[i] = nominal[i] * setting(name);
    for (const i of data.read) dead[i] = by(`dead-${i}`).checked ? 1 : 0;
  }
  function keep() {
    const row = kept.subarray(width * (count % KEPT)), time = count * interval;
    let k = 0;
    row[k++] = time;
    for (let j = 0; j < nj; j++) {
      row[k++] = truth[j]; row[k++] = told[2 * j]; row[k++] = told[2 * j + 1];
      row[k++] = data.plain ? told[at("health") + 1 + j] : NaN;
    }
    for (const [value, std, j] of torques) { row[k++] = truth[tensionsAt + data.tendons.length + j]; row[k++] = told[value]; row[k++] = told[std]; }
    readings.push([time, ...values, ...truth.subarray(0, nj)]);
    count += 1;
  }
  function begin() {
    count = 0; readings.length = 0; broken = false; hand = null; data.shape.most = most;
    aim(data.motion.map((m) => m.from));
    dead.fill(0);  // the first sample fills what has no prior
    wasm.lab_begin(Number(by("seed").value) >>> 0);
    nominal = nominal || Float64Array.from(numbers);
    keep();
  }
  function step() {
    act((count - 1) * interval);
    if (!wasm.lab_step()) broken = true;
    keep();
  }
  const angle = (j, what) => { const row = width * ((count - 1) % KEPT); return kept[row + 1 + 4 * j + what]; };
  const each = (what) => names.map((_, j) => angle(j, what));

  // the rig as it moves
  const picture = chainPicture(by("rig"), data.shape);
  function fitted() {
    const some = [];
    for (let time = 0; time < 20; time += 0.5) some.push(led(time, 1, 0.15));
    picture.fit(some);
  }

  // a chart's axes with ticks, time [s] to the right; returns where numbers lie
  function node(tag, attributes, text = "") {
    const made = document.createElementNS(by("angles").namespaceURI, tag);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    made.textContent = text;
    return made;
  }
  function short(value) {
    const size = Math.abs(value);
    return size >= 1e5 || (size > 0 && size < 1e-3) ? value.toExponential(1) : String(Number(value.toPrecision(3)));
  }
  function ticks(low, high) {
    const raw = (high - low) / 5, power = 10 ** Math.floor(Math.log10(raw)), found = [];
    const step = power * [1, 2, 5, 10].find((m) => m * power >= raw);
    for (let i = Math.ceil(low / step); i * step <= high; i++) found.push([i * step, short(i * step)]);
    return found;
  }
  function axes(svg, start, low, high, words) {
    const T = 12, R = 14, B = 24, W = svg.clientWidth, H = svg.clientHeight, end = start + data.window, levels = ticks(low, high);
    svg.replaceChildren();
    svg.setAttribute("viewBox", `0 0 ${W} ${H}`);
    const letter = matchMedia("(max-width: 40rem)").matches ? 10.5 : 7;
    const L = 34 + letter * Math.max(...levels.map(([, text]) => text.length), 3);
    const px = (v) => L + (v - start) / (end - start) * (W - L - R), py = (v) => H - B - (v - low) / (high - low) * (H - T - B);
    for (const [v, text] of ticks(start, end)) {
      svg.append(node("line", { x1: px(v), x2: px(v), y1: T, y2: H - B, class: "grid" }));
      svg.append(node("text", { x: px(v), y: H - B + 19, "text-anchor": "middle" }, `${text} s`));
    }
    for (const [v, text] of levels) {
      svg.append(node("line", { x1: L, x2: W - R, y1: py(v), y2: py(v), class: "grid" }));
      svg.append(node("text", { x: L - 6, y: py(v) + 4, "text-anchor": "end" }, text));
    }
    const middle = (T + H - B) / 2;
    svg.append(node("text", { x: 14, y: middle, "text-anchor": "middle", class: "name", transform: `rotate(-90 14 ${middle})` }, words));
    return [px, py];
  }

  // curves over time; lines: [value(row), class], bands: [low(row), high(row)]
  function curves(id, words) {
    const svg = by(id);
    let drawn = [];
    return {
      // time and every number of what was drawn, for each column of it
      numbers: () => drawn[0].map((row) => [kept[row], ...drawn[1].map((line) => line[0](row)), ...drawn[2].flat().map((edge) => edge(row))]),
      draw(lines, bands, least) {
        const shown = Math.min(count, KEPT), first = count - shown, start = first * interval, rows = [];
        const every = Math.max(1, Math.floor(shown / svg.clientWidth));
        for (let k = first; k < count; k++) if (k % every === 0) rows.push(width * (k % KEPT));
        drawn = [rows, lines, bands];
        const all = [...lines.map((line) => line[0]), ...bands.flat()].flatMap((value) => rows.map(value)).filter(Number.isFinite);
        const low = Math.min(...all), high = Math.max(...all), half = Math.max(least, 1.12 * (high - low)) / 2, middle = (low + high) / 2;
        const [px, py] = axes(svg, start, middle - half, middle + half, words);
        const points = (value) => rows.filter((row) => Number.isFinite(value(row))).map((row) => `${px(kept[row]).toFixed(1)},${py(value(row)).toFixed(1)}`);
        for (const [below, above] of bands) svg.append(node("polygon", { points: [...points(below), ...points(above).reverse()].join(" "), class: "band" }));
        for (const [value, kind] of lines) svg.append(node("polyline", { points: points(value).join(" "), class: kind }));
      },
    };
  }
  const angles = curves("angles", "angle [°]"), errors = curves("errors", "error [°]");
  const touch = torques.length ? curves("torque", "torque [N m]") : null;
  let pictured = [];

  function draw() {
    const halves = each(2).map((std) => data.band * std), tensions = [...truth.subarray(tensionsAt, tensionsAt + data.tendons.length)];
    data.shape.most = Math.max(data.shape.most, ...tensions.filter((x) => x < 1e4));
    pictured = [each(1), halves, each(0), tensions];
    picture.draw(...pictured);
  }
  function plot() {
    const of = (what, scale = 1 / DEGREE) => (row) => kept[row + 1 + 4 * joint + what] * scale;
    const half = (row) => (data.band * kept[row + 1 + 4 * joint + 2]) / DEGREE;
    const plain = data.plain ? [[of(3), "plain"]] : [];
    angles.draw([[of(0), "truth"], [of(1), "estimate"], ...plain], [[(r) => of(1)(r) - half(r), (r) => of(1)(r) + half(r)]], 10);
    const off = (line) => [(row) => line[0](row) - of(0)(row), line[1]];
    errors.draw([[of(1), "estimate"], ...plain].map(off), [[(r) => -half(r), half]], 2);
    const touched = torques.findIndex((t) => t[2] === joint), base = 1 + 4 * nj + 3 * touched;
    if (touched >= 0) {
      const value = (k) => (row) => kept[row + base + k], reach = (row) => data.band * kept[row + base + 2];
      touch.draw([[value(0), "truth"], [value(1), "estimate"]], [[(r) => value(1)(r) - reach(r), (r) => value(1)(r) + reach(r)]], 0.01 * data.loadMost);
    }
  }
  // a screen reader hears what an action brought and then the verdict, or a change of health; at most every 5 s
  let toSay = [], heard = "", silentUntil = 0;
  function speak(stamp) {
    if (!toSay.length || stamp < silentUntil) return;
    by("live").textContent = by(toSay.shift()).textContent; silentUntil = stamp + 5000;
  }
  // numbers and words, four times a second
  function tell() {
    const shown = Math.min(count, KEPT), first = count - shown;
    let square = 0, worst = 0, inside = 0, plainWorst = 0, n = 0;
    for (let k = first; k < count; k++) {
      const row = width * (k % KEPT) + 1 + 4 * joint, error = Math.abs(kept[row + 1] - kept[row]);
      if (k * interval < 1 && first === 0) continue;  // the first second, in which the zero is found
      square += error * error; worst = Math.max(worst, error); inside += error <= data.band * kept[row + 2]; n += 1;
      plainWorst = Math.max(plainWorst, Math.abs(kept[row + 3] - kept[row]));
    }
    const degrees = (x) => `${(x / DEGREE).toFixed(1)}°`;
    names.forEach((_, j) => { by(`now-${j}`).textContent = `${degrees(angle(j, 1))} ± ${degrees(data.band * angle(j, 2))}`; by(`true-${j}`).textContent = degrees(angle(j, 0)); });
    const word = data.health[told[at("health")]] || ["", ""];
    by("health").textContent = `${word[0]}: ${word[1]}`; by("health").className = word[0] === "ok" || word[0] === "untested" ? "yes" : "no";
    by("most").textContent = data.shape.most.toPrecision(2); by("clock").textContent = `${(count * interval).toFixed(1)} s`;
    const compared = data.plain ? ` Tendons taken as inextensible: wrong by up to ${degrees(plainWorst)}.` : "";
    by("verdict").textContent = broken ? "The motion left all bounds; press Begin anew." : !n ? "The first second, in which the filter finds its zero." : `Without a sensor in ${names[joint]}, its angle is ${angle(joint, 2) < Math.PI / 2 ? `known to ± ${degrees(data.band * angle(joint, 2))}` : "not known"}. In the last ${Math.min(data.window, Math.round(count * interval))} s it was wrong by ${degrees(Math.sqrt(square / n))} (RMS) and at most ${degrees(worst)}, and the band contained the truth for ${Math.round((100 * inside) / n)} % of the time.${compared}`;
    if (word[0] !== heard && count > 1) { heard = word[0]; if (!toSay.includes("health")) toSay.push("health"); }
    for (const name of Object.keys(settings)) { by(`${name}-said`).textContent = said(name); settings[name].setAttribute("aria-valuetext", said(name)); }
  }

  let before = null, due = 0, spoken = -1e9, plotted = -1e9, wall = 0, moved = 0;
  function frame(stamp) {
    const begun = performance.now();
    if (playing && !broken) {
      const gap = before === null ? 0 : (stamp - before) / 1000;
      due += Math.min(gap, 0.1);
      // a frame that computes for longer than this is not fluent: then the motion is slower than real time
      while (due >= interval && !broken && performance.now() - begun < 50) { step(); due -= interval; moved += interval; }
      due = Math.min(due, 0.1); wall += gap;
      if (wall >= 1) {
        by("pace").textContent = moved < 0.9 * wall ? `Slow motion: this computer reaches ${(moved / wall).toPrecision(1)} of real time.` : "";
        wall = moved = 0;
      }
    }
    before = stamp;
    draw();
    if (stamp - plotted > 50) { plotted = stamp; plot(); }  // twenty times a second
    if (stamp - spoken > 250) { spoken = stamp; tell(); speak(stamp); }
    frames += 1;
    lab.dataset.frames = frames;
    (lab.times = lab.times || []).push(performance.now() - begun);
    if (lab.times.length > 600) lab.times.shift();
    requestAnimationFrame(frame);
  }

  // mouse and touch: a link that is taken is pulled to the pointer by a spring
  const canvas = by("rig");
  function pointed(e) { const box = canvas.getBoundingClientRect(); return [e.clientX - box.left, e.clientY - box.top]; }
  function towards(j, [px, py]) {
    const now = each(0), off = (a) => {
      const [[ax, ay], [bx, by_]] = picture.sight(now, j, a), length = Math.hypot(px - ax, py - ay) || 1, own = Math.hypot(bx - ax, by_ - ay) || 1;
      return -((bx - ax) * (px - ax) + (by_ - ay) * (py - ay)) / (length * own);
    };
    let best = now[j];
    for (let i = -90; i <= 90; i++) { const a = now[j] + (i / 90) * 1.5; if (off(a) < off(best)) best = a; }
    return best;
  }
  canvas.addEventListener("pointerdown", (e) => {
    const p = pointed(e), now = each(0), reach = (j) => {
      const [[ax, ay], [bx, by_]] = picture.sight(now, j, now[j]), dx = bx - ax, dy = by_ - ay;
      const t = Math.min(Math.max(((p[0] - ax) * dx + (p[1] - ay) * dy) / (dx * dx + dy * dy || 1), 0), 1);
      return Math.hypot(p[0] - ax - t * dx, p[1] - ay - t * dy);
    };
    const nearest = names.map((_, j) => j).reduce((a, b) => (reach(b) < reach(a) ? b : a));
    hand = { joint: nearest, angle: towards(nearest, p) };
    canvas.setPointerCapture(e.pointerId);
  });
  canvas.addEventListener("pointermove", (e) => { if (hand) hand.angle = towards(hand.joint, pointed(e)); });
  for (const kind of ["pointerup", "pointercancel"]) canvas.addEventListener(kind, () => { hand = null; });

  by("play").addEventListener("click", () => { playing = !playing; by("play").textContent = playing ? "Pause" : "Go on"; });
  by("again").addEventListener("click", () => { begin(); tell(); });
  function choose(j) {
    joint = j;
    if (setting("load") === 0) loaded = j;
    if (touch) by("torque").closest("figure").hidden = !torques.some((t) => t[2] === j);
    tell();
  }
  by("joint").addEventListener("change", (e) => choose(Number(e.target.value)));
  // what is set by hand is no experiment any more
  function byHand(input) {
    if (input.name === "load") loaded = joint;
    const named = (one) => `${one.labels[0].firstChild.textContent.trim()}${one.name === "load" ? ` (${names[loaded]})` : ""} ${said(one.name)}`;
    const changed = Object.values(settings).filter((one) => one.value !== one.defaultValue).map(named);
    const unplugged = data.read.filter((i) => by(`dead-${i}`).checked).map((i) => `${sensors[i]} dead`);
    for (const button of experiments) button.setAttribute("aria-pressed", "false");
    by("why").textContent = changed.length + unplugged.length ? `Set by hand: ${[...changed, ...unplugged].join(", ")}.` : "As the rig file says again. The filter goes on with what it has learned; Begin anew resets it.";
    toSay = ["verdict"]; tell();
  }
  // an experiment begins anew: plant and filter from the start, and nothing is left of another one
  const experiments = [...lab.querySelectorAll("button[data-set]")];
  for (const button of experiments)
    button.addEventListener("click", () => {
      const wanted = JSON.parse(button.dataset.set);
      for (const input of Object.values(settings)) input.value = wanted[input.name] ?? input.defaultValue;
      for (const i of data.read) by(`dead-${i}`).checked = (wanted.dead || []).includes(i);
      if (free.length) by("bring").checked = false;
      for (const one of experiments) one.setAttribute("aria-pressed", String(one === button));
      loaded = joint; by("why").textContent = button.dataset.why; by("saved").textContent = "";
      toSay = ["why", "verdict"]; begin(); tell();
    });
  function csv() {
    const lines = [data.columns.map((c) => (/[",]/.test(c) ? `"${c.replaceAll('"', '""')}"` : c)).join(",")];
    for (const row of readings) lines.push(row.map((x, i) => (Number.isFinite(x) ? String(x / data.scales[i]) : "")).join(","));
    return `${lines.join("\n")}\n`;
  }
  by("save").addEventListener("click", () => {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([csv()], { type: "text/csv" })); link.download = "lab.csv"; link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
    by("saved").textContent = `Saved ${readings.length} samples, from the beginning; ${data.command}`;
  });
  window.addEventListener("resize", fitted);
  if (free.length) by("bring").addEventListener("input", () => tell());
  for (const input of [...Object.values(settings), ...data.read.map((i) => by(`dead-${i}`))]) input.addEventListener("input", () => byHand(input));

  // what a test needs: run on without waiting, and say what was kept
  lab.run = (seconds) => { for (const end = count + Math.round(seconds / interval); count < end; ) step(); };
  lab.begin = begin; lab.csv = csv; lab.pause = () => { if (playing) by("play").click(); };
  lab.last = () => [...kept.subarray(width * ((count - 1) % KEPT)).subarray(0, width)];
  lab.acted = () => [...pull];
  lab.drawn = () => { draw(); plot(); return { angles: angles.numbers(), errors: errors.numbers(), torque: touch && !by("torque").closest("figure").hidden ? touch.numbers() : [], pictured }; };
  by("why").textContent = experiments[0].dataset.why;
  begin(); choose(joint); fitted(); draw();
  lab.dataset.first = performance.now().toFixed(1);  // since the page was opened [ms]
  requestAnimationFrame(frame);
})();
