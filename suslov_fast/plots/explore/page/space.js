// The body in space: its ellipsoid of inertia, its axes and the path of the constrained axis.

import { MATH, colours, disc, stroke, surface, write } from "./pen.js";
import { byId, last, state } from "./state.js";

const AXES = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
const TIP = 1.3; // length of an axis; the largest semi-axis of the ellipsoid is 1
const TRAIL = 40, ARCS = 24; // steps in the path, and lines per step
const AROUND = 32, ALONG = 16; // patches of the ellipsoid around its axis and along it
const camera = { turn: -0.7, lift: 0.42 };

const dot = (u, v) => u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
const scaled = (v, factor) => v.map((each) => each * factor);
const times = (R, v) => [0, 3, 6].map((i) => R[i] * v[0] + R[i + 1] * v[1] + R[i + 2] * v[2]);
const column = (rows, k) => rows.map((row) => row[k]);

export function look(turn, lift) {
  camera.turn -= turn;
  camera.lift = Math.min(Math.max(camera.lift + lift, -1.5), 1.5);
  drawSpace();
}

// Returns camera coordinates: to the right, up, towards the eye. The camera looks at the origin.
function seen([x, y, z]) {
  const { turn, lift } = camera;
  const right = -Math.sin(turn) * x + Math.cos(turn) * y;
  const away = Math.cos(turn) * x + Math.sin(turn) * y;
  return [right, Math.cos(lift) * z - Math.sin(lift) * away, Math.cos(lift) * away + Math.sin(lift) * z];
}

export function drawSpace() {
  const { pen, width, height } = surface(byId("space"));
  const R = state.scene && orientation(state.moment, state.share);
  byId("legend-omega").hidden = !(R && velocity(R));
  if (!R) return;
  const scale = Math.min(width, height) / 3.25;
  const at = ([right, up]) => [width / 2 + right * scale, height / 2 - up * scale];
  const angles = Array.from({ length: 91 }, (_, k) => (k * Math.PI) / 45);
  const ring = angles.map((angle) => [TIP * Math.cos(angle), TIP * Math.sin(angle), 0]);
  stroke(pen, ring.map((point) => at(seen(point))), colours.edge, 1);
  const path = trail().map((axis) => seen(scaled(axis, TIP)));
  const arrows = tips(R);
  // First what is behind the body, then the body, then what is in front of it.
  for (const front of [false, true]) {
    if (front) drawEllipsoid(pen, at, R);
    const near = (point) => point && point[2] > 0 === front;
    const part = path.map((point, k) => (near(point) || near(path[k - 1]) ? at(point) : null));
    pen.globalAlpha = front ? 1 : 0.45;
    stroke(pen, part, colours.line, 1.6);
    pen.globalAlpha = 1;
    for (const arrow of arrows) if (near(arrow.tip)) drawArrow(pen, at, arrow, front, R);
  }
}

// Returns the axes of the body and its angular velocity as arrows in camera coordinates.
function tips(R) {
  const names = ["e₁", "e₂", "a"], inks = [colours.text, colours.text, colours.line];
  const arrows = AXES.map((axis, k) =>
    ({ tip: seen(scaled(times(R, axis), TIP)), name: names[k], colour: inks[k] }));
  const omega = velocity(R);
  if (omega) arrows.push({ tip: seen(scaled(omega, TIP)), name: "Ω", colour: colours.omega });
  return arrows;
}

// Returns the angular velocity relative to the largest one of the orbit; null if all are 0.
function velocity(R) {
  const { omega } = state.scene, now = omega[Math.min(state.moment, last())];
  const most = Math.max(...omega.map((each) => (each ? Math.hypot(...each) : 0)));
  return now && most > 0 ? scaled(times(R, [...now, 0]), 1 / most) : null;
}

function drawArrow(pen, at, { tip, name, colour }, front, R) {
  // An arrow in front of the body is visible from the point where it leaves the body.
  const inside = front ? Math.min(1, leaving(tip, R) / Math.max(Math.hypot(...tip), 1e-9)) : 0;
  const [x, y] = at(tip), [x0, y0] = at([0, 0]), far = Math.max(Math.hypot(x - x0, y - y0), 1);
  stroke(pen, [at(scaled(tip, inside)), [x, y]], colour, 2.4);
  disc(pen, [x, y], 3.2, colour);
  const place = [x + (14 * (x - x0)) / far, y + (14 * (y - y0)) / far + 5];
  write(pen, name, ...place, { font: MATH, colour });
}

// Returns the orientation between states n and n + 1, after a part of the rotation from one to the
// other. A step rotates the body about one axis, by less than half a turn.
export function orientation(n, part) {
  const { attitude } = state.scene, R = attitude[Math.min(n, last())], S = attitude[n + 1];
  if (!R || !S || !part) return R;
  const turn = (i, j) => R[i] * S[j] + R[3 + i] * S[3 + j] + R[6 + i] * S[6 + j];
  const axis = [turn(2, 1) - turn(1, 2), turn(0, 2) - turn(2, 0), turn(1, 0) - turn(0, 1)];
  const sine = Math.hypot(...axis) / 2, cosine = (turn(0, 0) + turn(1, 1) + turn(2, 2) - 1) / 2;
  if (sine < 1e-9) return R;
  const [x, y, z] = scaled(axis, 0.5 / sine), angle = part * Math.atan2(sine, cosine);
  const c = Math.cos(angle), s = Math.sin(angle), d = 1 - c;
  const T = [
    [c + d * x * x, d * x * y - s * z, d * x * z + s * y],
    [d * x * y + s * z, c + d * y * y, d * y * z - s * x],
    [d * x * z - s * y, d * y * z + s * x, c + d * z * z],
  ];
  return [0, 3, 6].flatMap((i) => [0, 1, 2].map((j) => dot(R.slice(i, i + 3), column(T, j))));
}

// Returns the path of the axis a over the last steps, a circular arc for each.
function trail() {
  const { moment, share } = state, found = [];
  for (let n = Math.max(0, moment - TRAIL); n <= moment; n++) {
    const parts = n < moment ? ARCS : Math.floor(share * ARCS) + 1;
    for (let k = 0; k < parts; k++) found.push(orientation(n, k / ARCS));
  }
  found.push(orientation(moment, share));
  return found.filter(Boolean).map((R) => [R[2], R[5], R[8]]);
}

// Returns the directions of the semi-axes in camera coordinates.
const frame = (R) => [0, 1, 2].map((k) => seen(times(R, column(state.scene.ellipsoid.axes, k))));

// Returns the distance from the origin to the ellipsoid along an arrow.
function leaving(tip, R) {
  if (!state.scene.ellipsoid) return 0;
  const { radii } = state.scene.ellipsoid, length = Math.hypot(...tip) || 1;
  return 1 / Math.hypot(...frame(R).map((axis, k) => dot(axis, tip) / length / radii[k]));
}

function drawEllipsoid(pen, at, R) {
  if (!state.scene.ellipsoid) return;
  const { radii } = state.scene.ellipsoid, axes = frame(R);
  const point = (parts) => [0, 1, 2].map((i) => dot(column(axes, i), parts));
  const sphere = (i, j) => {
    const u = (2 * Math.PI * i) / AROUND, v = (Math.PI * j) / ALONG;
    return [Math.cos(u) * Math.sin(v), Math.sin(u) * Math.sin(v), Math.cos(v)];
  };
  const corner = (i, j) => at(point(sphere(i, j).map((each, k) => each * radii[k])));
  for (let j = 0; j < ALONG; j++) {
    for (let i = 0; i < AROUND; i++) {
      const normal = point(sphere(i + 0.5, j + 0.5).map((each, k) => each / radii[k]));
      if (normal[2] <= 0) continue; // faces away, hidden because the body is convex
      const patch = colours.patches[(Math.floor(i / 4) + Math.floor(j / 4)) % 2];
      pen.fillStyle = pen.strokeStyle = shade(patch, normal);
      pen.beginPath();
      for (const [a, b] of [[0, 0], [1, 0], [1, 1], [0, 1]]) pen.lineTo(...corner(i + a, j + b));
      pen.closePath();
      pen.lineWidth = 0.7;
      pen.fill();
      pen.stroke();
    }
  }
}

// Returns the colour of a patch lit from the upper right, in front of the screen.
function shade(patch, normal) {
  const light = Math.max(0, dot([0.35, 0.5, 0.8], normal) / Math.hypot(...normal));
  const rgb = patch.map((each) => Math.round(Math.min(255, each * (0.5 + 0.62 * light))));
  return `rgb(${rgb.join(" ")})`;
}
