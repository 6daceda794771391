// A chain of joints on a canvas: links, the band of each angle as a fan, tendons coloured by their tension.
"use strict";
const chainVectors = {
  add: (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]],
  cross: (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]],
  dot: (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2],
  unit: (v) => { const n = Math.hypot(...v) || 1; return v.map((x) => x / n); },
  // Rodrigues: v turned about the unit vector a
  turned: (v, a, angle) => {
    const { dot, cross } = chainVectors, c = Math.cos(angle), s = Math.sin(angle), k = dot(a, v) * (1 - c), w = cross(a, v);
    return [c * v[0] + s * w[0] + k * a[0], c * v[1] + s * w[1] + k * a[1], c * v[2] + s * w[2] + k * a[2]];
  },
};

// shape: joints, tendons, view (what points right and up), colours, ramp, most (the largest tension of the scale)
function chainPicture(canvas, shape) {
  const { add, cross, dot, unit, turned } = chainVectors, { joints, tendons, colours } = shape;
  const pen = canvas.getContext("2d"), times = (m, v) => [dot(m[0], v), dot(m[1], v), dot(m[2], v)];
  const columns = (m) => [[m[0][0], m[1][0], m[2][0]], [m[0][1], m[1][1], m[2][1]], [m[0][2], m[1][2], m[2][2]]];
  let scale = 1, middle = [0, 0];
  const picture = { view: shape.view, posture, fit, draw, flat, sight };

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
  function flat(p) { return [middle[0] + scale * dot(p, picture.view[0]), middle[1] - scale * dot(p, picture.view[1])]; }
  // where a joint's link begins and ends on the canvas when its own angle is another one
  function sight(angles, j, angle) {
    const p = posture(angles)[j], way = times(p.before, turned(joints[j].link, joints[j].axis, angle));
    return [flat(p.at), flat(add(p.at, way))];
  }
  // the box that the chain moves in, as it is seen: the picture stands still while it moves
  function fit(postures) {
    const ratio = window.devicePixelRatio || 1, box = canvas.getBoundingClientRect();
    canvas.width = box.width * ratio; canvas.height = box.height * ratio;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    const low = [0, 0], high = [0, 0];
    for (const angles of postures)
      posture(angles).forEach((p, j) => {
        const size = 0.3 * Math.hypot(...joints[j].link);
        for (const at of [p.at, add(p.at, times(p.frame, joints[j].link))])
          picture.view.forEach((way, i) => { low[i] = Math.min(low[i], dot(at, way) - size); high[i] = Math.max(high[i], dot(at, way) + size); });
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
    const t = Math.min(Math.max(tension / (shape.most || 1), 0), 1) * (shape.ramp.length - 1), i = Math.min(Math.floor(t), shape.ramp.length - 2);
    const mixed = shape.ramp[i].map((x, c) => Math.round(x + (t - i) * (shape.ramp[i + 1][c] - x)));
    return `rgb(${mixed})`;
  }
  function skeleton(placed, stroke, width, dash) {
    placed.forEach((p, j) => line([p.at, add(p.at, times(p.frame, joints[j].link))], stroke, width, dash));
  }
  // truths may be null, and any of the tensions
  function draw(angles, halves, truths, tensions) {
    const box = canvas.getBoundingClientRect(), placed = posture(angles);
    pen.clearRect(0, 0, box.width, box.height);
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
    skeleton(placed, colours.estimate, 5, []);
    if (truths) skeleton(posture(truths), colours.ink, 1.5, [4, 4]);
    placed.forEach((p) => { const [x, y] = flat(p.at); pen.setLineDash([]); pen.beginPath(); pen.arc(x, y, 5, 0, 7); pen.fillStyle = colours.paper; pen.fill(); pen.lineWidth = 2; pen.strokeStyle = colours.estimate; pen.stroke(); });
    tendons.forEach((tendon, k) => {
      const points = [];
      tendon.crossings.forEach(([j, arm], i) => {
        const p = placed[j], link = unit(times(p.frame, joints[j].link)), old = unit(times(p.before, joints[j].link));
        const side = unit(cross(p.axis, unit(add(link, old))));  // half way between the links on both sides
        const at = add(p.at, side, arm);
        if (!i) points.push(add(at, old, -0.4 * Math.hypot(...joints[j].link)));
        points.push(at);
        if (i === tendon.crossings.length - 1) points.push(add(add(p.at, cross(p.axis, link), 0.5 * arm), link, 0.5 * Math.hypot(...joints[j].link)));
      });
      line(points, colours.paper, 5); line(points, colour(tensions[k]), 3);
    });
  }
  return picture;
}
