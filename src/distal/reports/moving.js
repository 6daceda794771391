// The chain of a log, played and scrubbed.
"use strict";
{
  const { add, dot, unit, turned } = chainVectors;
  const figure = document.getElementById("moving");
  const data = JSON.parse(document.getElementById("moving-data").textContent);
  const canvas = figure.querySelector("canvas"), chain = chainPicture(canvas, data);
  const button = figure.querySelector("button"), scrub = figure.querySelector("input");
  const speed = figure.querySelector("select"), clock = figure.querySelector("output"), cells = figure.querySelectorAll("td.n");
  const { joints, colours } = data, count = data.time.length, last = data.time[count - 1];
  const rest = [...data.view];
  let now = 0, playing = false, before = null, spent = 0, drawn = 0;

  const row = (table, k) => joints.map((_, j) => table[j][k]);
  // the last sample at a time
  function index(time) {
    let low = 0, high = count - 1;
    while (low < high) { const middle = (low + high + 1) >> 1; if (data.time[middle] <= time) low = middle; else high = middle - 1; }
    return low;
  }
  function fitted() {
    const some = [];
    for (let k = 0; k < count; k += Math.max(1, Math.floor(count / 60))) some.push(row(data.angles, k));
    chain.fit(some);
  }
  function draw() {
    const started = performance.now(), k = index(now), angles = row(data.angles, k), halves = row(data.halves, k);
    const truths = data.truths && row(data.truths, k), naive = data.naive && row(data.naive, k);
    chain.draw(angles, halves, truths, data.tensions.map((values) => values && values[k]), naive);
    clock.textContent = `${now.toFixed(2)} s of ${last.toFixed(2)} s`;
    const degrees = (angle) => `${((angle * 180) / Math.PI).toFixed(1)}°`;
    cells.forEach((cell, j) => {
      cell.textContent = `${degrees(angles[j])} ± ${degrees(halves[j])}`;
      if (naive) cell.textContent += `, true ${degrees(truths[j])}, as if nothing stretched ${degrees(naive[j])}`;
    });
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
    const size = layout._size, x = layout.xaxis.l2p(now);
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
    const right = turned(chain.view[0], chain.view[1], -dx), up = turned(chain.view[1], right, -dy);
    chain.view = [unit(right), unit(add(up, right, -dot(up, right)))]; fitted(); draw();
  });
  canvas.addEventListener("dblclick", () => { chain.view = [...rest]; fitted(); draw(); });
  window.addEventListener("resize", () => { fitted(); draw(); });
  if (plot && plot.on) plot.on("plotly_click", (e) => { play(false); now = Math.min(Math.max(e.points[0].x, 0), last); draw(); });
  figure.placesAt = (k) => chain.posture(row(data.angles, k)).map((p) => p.at);
  fitted(); draw();
  if (location.hash === "#play" || (data.naive && !matchMedia("(prefers-reduced-motion: reduce)").matches)) play(true);
}
