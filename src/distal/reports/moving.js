// The chain of a log, drawn as it moves: links, the band of each angle as a fan, tendons coloured by their tension.
"use strict";
{
  const figure = document.getElementById("moving");
  const data = JSON.parse(document.getElementById("moving-data").textContent);
  const canvas = figure.querySelector("canvas"), pen = canvas.getContext("2d");
  const button = figure.querySelector("button"), scrub = figure.querySelector("input");
  const speed = figure.querySelector("select"), clock = figure.querySelector("output"), cells = figure.querySelectorAll("td.n");
  const { joints, tendons, colours } = data, count = data.time.length, last = data.time[count - 1];
  const rest = [...data.view];
  let view = data.view, now = 0, playing = false, before = null, spent = 0, drawn = 0;

  const add = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const times = (m, v) => [dot(m[0], v), dot(m[1], v), dot(m[2], v)];
  const unit = (v) => { const n = Math.hypot(...v) || 1; return v.map((x) => x / n); };
  // Rodrigues: v turned about the unit vector a
  const turned = (v, a, angle) => {
    const c = Math.cos(angle), s = Math.sin(angle), k = dot(a, v) * (1 - c), w = cross(a, v);
    return [c * v[0] + s * w[0] + k * a[0], c * v[1] + s * w[1] + k * a[1], c * v[2] + s * w[2] + k * a[2]];
  };
  const columns = (m) => [[m[0][0], m[1][0], m[2][0]], [m[0][1], m[1][1], m[2][1]], [m[0][2], m[1][2], m[2][2]]];

  // places and frames of all joints at some angles: p = p_parent + R_parent offset, R = R_parent Rot(axis, θ)
  function posture(angles) {
    const placed = [];
    joints.forEach((joint, j) => {
      const base = joint.parent < 0 ? { at: [0, 0, 0], frame: [[1, 0, 0], [0, 1, 0], [0, 0, 1]] } : placed[joint.parent];
      const at = add(base.at, times(base.frame, joint.offset));
      const axis = times(base.frame, joint.axis), own = columns(base.frame).map((v) => turned(v, axis, angles[j]));
      placed.push({ at, axis, before: base.frame, frame: columns(own) });
    });
    return placed;
  }
  const row = (table, k) => joints.map((_, j) => table[j][k]);
  // the last sample at a time
  function index(time) {
    let low = 0, high = count - 1;
    while (low < high) { const middle = (low + high + 1) >> 1; if (data.time[middle] <= time) low = middle; else high = middle - 1; }
    return low;
  }
  // the box that the chain moves in, as it is seen: the picture stands still while it is played
  let scale = 1, middle = [0, 0];
  const flat = (p) => [middle[0] + scale * dot(p, view[0]), middle[1] - scale * dot(p, view[1])];
  function fitted() {
    const ratio = window.devicePixelRatio || 1, box = canvas.getBoundingClientRect();
    canvas.width = box.width * ratio; canvas.height = box.height * ratio;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    const low = [0, 0], high = [0, 0];
    for (let k = 0; k < count; k += Math.max(1, Math.floor(count / 60)))
      posture(row(data.angles, k)).forEach((p, j) => {
        const size = 0.3 * Math.hypot(...joints[j].link);
        for (const at of [p.at, add(p.at, times(p.frame, joints[j].link))])
          view.forEach((way, i) => { low[i] = Math.min(low[i], dot(at, way) - size); high[i] = Math.max(high[i], dot(at, way) + size); });
      });
    scale = 0.94 * Math.min(box.width / (high[0] - low[0]), box.height / (high[1] - low[1]));
    middle = [box.width / 2 - (scale * (low[0] + high[0])) / 2, box.height / 2 + (scale * (low[1] + high[1])) / 2];
  }
  function line(points, colour, width, dash = []) {
    pen.beginPath(); pen.setLineDash(dash); pen.lineWidth = width; pen.strokeStyle = colour; pen.lineCap = pen.lineJoin = "round";
    points.forEach((p, i) => (i ? pen.lineTo(...flat(p)) : pen.moveTo(...flat(p)))); pen.stroke();
  }
  function colour(tension) {  // cividis: it rises in lightness, for all kinds of colour vision
    if (tension === null || tension === undefined) return colours.soft;
    const t = Math.min(Math.max(tension / (data.most || 1), 0), 1) * (data.ramp.length - 1), i = Math.min(Math.floor(t), data.ramp.length - 2);
    const mixed = data.ramp[i].map((x, c) => Math.round(x + (t - i) * (data.ramp[i + 1][c] - x)));
    return `rgb(${mixed})`;
  }
  function skeleton(angles, stroke, width, dash) {
    const placed = posture(angles);
    placed.forEach((p, j) => line([p.at, add(p.at, times(p.frame, joints[j].link))], stroke, width, dash));
    return placed;
  }
  function draw() {
    const started = performance.now(), k = index(now), box = canvas.getBoundingClientRect();
    pen.clearRect(0, 0, box.width, box.height);
    const angles = row(data.angles, k), halves = row(data.halves, k), placed = posture(angles);
    placed.forEach((p, j) => {  // the fan: where the link may point, with the joints before it as they are estimated
      pen.beginPath(); pen.moveTo(...flat(p.at));
      for (let i = -8; i <= 8; i++) {
        const way = times(p.before, turned(joints[j].link, joints[j].axis, angles[j] + (i / 8) * Math.min(halves[j], Math.PI)));
        pen.lineTo(...flat(add(p.at, way)));
      }
      pen.closePath(); pen.fillStyle = colours.band; pen.fill();
    });
    joints.forEach((joint, j) => {  // the base, up to the first joint of each finger
      const short = 0.3 * Math.hypot(...joint.link);
      if (joint.parent < 0) line([add(placed[j].at, unit(joint.link), -short), placed[j].at], colours.soft, 9);
    });
    skeleton(angles, colours.estimate, 5, []);
    if (data.truths) skeleton(row(data.truths, k), colours.ink, 1.5, [4, 4]);
    placed.forEach((p) => { const [x, y] = flat(p.at); pen.setLineDash([]); pen.beginPath(); pen.arc(x, y, 5, 0, 7); pen.fillStyle = colours.paper; pen.fill(); pen.lineWidth = 2; pen.strokeStyle = colours.estimate; pen.stroke(); });
    tendons.forEach((tendon) => {
      const points = [];
      tendon.crossings.forEach(([j, arm], i) => {
        const p = placed[j], link = unit(times(p.frame, joints[j].link)), old = unit(times(p.before, joints[j].link));
        const side = unit(cross(p.axis, unit(add(link, old))));  // half way between the links on both sides
        const at = add(p.at, side, arm);
        if (!i) points.push(add(at, old, -0.4 * Math.hypot(...joints[j].link)));
        points.push(at);
        if (i === tendon.crossings.length - 1) points.push(add(add(p.at, cross(p.axis, link), 0.5 * arm), link, 0.5 * Math.hypot(...joints[j].link)));
      });
      line(points, colours.paper, 5); line(points, colour(tendon.tension && tendon.tension[k]), 3);
    });
    clock.textContent = `${now.toFixed(2)} s of ${last.toFixed(2)} s`;
    cells.forEach((cell, j) => { cell.textContent = `${((angles[j] * 180) / Math.PI).toFixed(1)}° ± ${((halves[j] * 180) / Math.PI).toFixed(1)}°`; });
    scrub.value = now; cursor();
    spent += performance.now() - started; drawn += 1;
    figure.dataset.frames = drawn; figure.dataset.work = (spent / drawn).toFixed(2);
  }
  // the same time in the curves: a line over them, which costs no new drawing
  const plot = document.querySelector(".js-plotly-plot"), mark = document.createElement("div");
  mark.style.cssText = `position:absolute;width:1px;background:${colours.ink};pointer-events:none`;
  function cursor() {
    const layout = plot && plot._fullLayout;
    if (!layout || !layout._size) return;
    if (!mark.parentNode) { plot.style.position = "relative"; plot.append(mark); }
    const size = layout._size, x = layout.xaxis.l2p(data.from + now);
    mark.hidden = !(x >= 0 && x <= size.w);
    Object.assign(mark.style, { left: `${size.l + x}px`, top: `${size.t}px`, height: `${size.h}px` });
  }
  function frame(stamp) {
    if (!playing) return;
    if (before !== null) now += ((stamp - before) / 1000) * Number(speed.value);
    before = stamp;
    if (now > last) now = 0;
    draw();
    requestAnimationFrame(frame);
  }
  function play(on) {
    playing = on; before = null; button.textContent = on ? "Pause" : "Play";
    if (on) requestAnimationFrame(frame);
  }
  button.addEventListener("click", () => play(!playing));
  scrub.addEventListener("input", () => { play(false); now = Number(scrub.value); draw(); });
  let dragged = null;
  canvas.addEventListener("pointerdown", (e) => { dragged = [e.clientX, e.clientY]; canvas.setPointerCapture(e.pointerId); });
  canvas.addEventListener("pointerup", () => { dragged = null; });
  canvas.addEventListener("pointermove", (e) => {
    if (!dragged) return;
    const [dx, dy] = [(e.clientX - dragged[0]) / 150, (e.clientY - dragged[1]) / 150];
    dragged = [e.clientX, e.clientY];
    const right = turned(view[0], view[1], -dx), up = turned(view[1], right, -dy);
    view = [unit(right), unit(add(up, right, -dot(up, right)))]; fitted(); draw();
  });
  canvas.addEventListener("dblclick", () => { view = [...rest]; fitted(); draw(); });
  window.addEventListener("resize", () => { fitted(); draw(); });
  if (plot && plot.on) plot.on("plotly_click", (e) => { play(false); now = Math.min(Math.max(e.points[0].x - data.from, 0), last); draw(); });
  figure.placesAt = (k) => posture(row(data.angles, k)).map((p) => p.at);
  fitted(); draw();
  if (location.hash === "#play") play(true);
}
