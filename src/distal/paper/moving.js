// The link of a tendon-driven rig as it moves: the truth, what its tendons say as if they did not stretch, and the band.
"use strict";
(() => {
  const data = JSON.parse(document.getElementById("link-data").textContent);
  const figure = document.getElementById("link"), button = figure.querySelector("button");
  const range = figure.querySelector("input"), said = figure.querySelector("output");
  const [fan, naive, truth] = ["fan", "naive", "truth"].map((name) => figure.querySelector("." + name));
  const cords = [...figure.querySelectorAll(".cord")], R = 150, DISK = 34;
  const at = (angle, r) => [r * Math.cos(angle), -r * Math.sin(angle)];
  let playing = !matchMedia("(prefers-reduced-motion: reduce)").matches, shown = 0, before = null;

  const line = (element, angle) => {
    const [x, y] = at(angle, R);
    element.setAttribute("x2", x.toFixed(1));
    element.setAttribute("y2", y.toFixed(1));
  };
  const draw = () => {
    const k = Math.min(Math.floor(shown / data.step), data.truth.length - 1);
    const low = data.estimate[k] - data.half[k], high = data.estimate[k] + data.half[k];
    const [a, b] = [at(low, R), at(high, R)];
    fan.setAttribute("d", `M0 0 L${a} A${R} ${R} 0 ${high - low > Math.PI ? 1 : 0} 0 ${b} Z`);
    line(truth, data.truth[k]);
    line(naive, data.naive[k]);
    cords.forEach((cord, i) => {
      const side = i ? -1 : 1, pulled = data.positions[i][k] * 2500;
      cord.setAttribute("d", `M${at(data.truth[k] + side * Math.PI / 2, DISK)} L${-170 - pulled} ${side * -DISK * 1.1}`);
    });
    const degrees = (angle) => (180 / Math.PI * angle).toFixed(0) + "°";
    said.textContent = `true ${degrees(data.truth[k])}, as if nothing stretched ${degrees(data.naive[k])}, ` +
      `distal ${degrees(data.estimate[k])} ± ${degrees(data.half[k])}`;
    range.value = shown;
  };
  const frame = (now) => {
    if (playing && before !== null) shown = (shown + (now - before) / 1000) % (data.step * data.truth.length);
    before = playing ? now : null;
    draw();
    if (playing) requestAnimationFrame(frame);
  };
  const play = (on) => {
    playing = on;
    button.textContent = on ? "Pause" : "Play";
    before = null;
    if (on) requestAnimationFrame(frame);
  };
  button.addEventListener("click", () => play(!playing));
  range.addEventListener("input", () => { play(false); shown = Number(range.value); draw(); });
  draw();
  play(playing);
})();
