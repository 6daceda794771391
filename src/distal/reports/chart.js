// Charts in SVG: their axes with ticks, lines and areas.
"use strict";
const chart = (() => {
  const NS = document.querySelector("svg.chart")?.namespaceURI;

  function node(tag, attributes, text) {
    const made = document.createElementNS(NS, tag);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    if (text !== undefined) made.textContent = text;
    return made;
  }

  function short(value) {
    if (value === 0) return "0";
    const size = Math.abs(value);
    return size >= 1e5 || size < 1e-3 ? value.toExponential(1) : String(Number(value.toPrecision(3)));
  }

  function ticks(axis) {
    if (axis.labels) return axis.labels.map((text, i) => [i, text]);
    if (axis.log) {
      const found = [], few = axis.high - axis.low > 2.5 ? [1] : [1, 2, 5];
      for (let p = Math.floor(axis.low); p <= axis.high; p++) for (const m of few) {
        const v = p + Math.log10(m);
        if (v >= axis.low && v <= axis.high) found.push([v, short(m * 10 ** p)]);
      }
      return found;
    }
    const span = axis.high - axis.low, raw = span / 5, power = 10 ** Math.floor(Math.log10(raw));
    const step = power * [1, 2, 5, 10].find((m) => m * power >= raw), found = [];
    for (let i = Math.ceil(axis.low / step); i * step <= axis.high; i++) found.push([i * step, short(i * step) + (axis.unit || "")]);
    return found;
  }

  // axes: low, high, words, perhaps labels, log, or the unit of ticks; returns where numbers lie
  function frame(svg, x, y, W = 640, H = 400) {
    const T = 12, R = 14, B = x.words ? 54 : 24;
    svg.replaceChildren();
    svg.setAttribute("viewBox", `0 0 ${W} ${H}`);
    const letter = matchMedia("(max-width: 40rem)").matches ? 10.5 : 7;
    const L = 34 + letter * Math.max(...ticks(y).map(([, text]) => text.length), 3);
    const px = (v) => L + (v - x.low) / (x.high - x.low) * (W - L - R);
    const py = (v) => H - B - (v - y.low) / (y.high - y.low) * (H - T - B);
    for (const [v, text] of ticks(x)) {
      svg.append(node("line", { x1: px(v), x2: px(v), y1: T, y2: H - B, class: "grid" }));
      svg.append(node("text", { x: px(v), y: H - B + 19, "text-anchor": "middle" }, text));
    }
    for (const [v, text] of ticks(y)) {
      svg.append(node("line", { x1: L, x2: W - R, y1: py(v), y2: py(v), class: "grid" }));
      svg.append(node("text", { x: L - 6, y: py(v) + 4, "text-anchor": "end" }, text));
    }
    svg.append(node("text", { x: (L + W - R) / 2, y: H - 8, "text-anchor": "middle", class: "name" }, x.words));
    svg.append(node("text", { x: 14, y: (T + H - B) / 2, "text-anchor": "middle", class: "name",
      transform: `rotate(-90 14 ${(T + H - B) / 2})` }, y.words));
    return [px, py];
  }

  return { node, short, frame };
})();
