// The plane of Omega1 and Omega2: levels, orbits and steady states.

import { MATH, colours, disc, stroke, surface, write } from "./pen.js";
import { byId, last, state } from "./state.js";

export const MARGIN = { left: 46, right: 12, top: 24, bottom: 34 };

// Returns the frame of the plane in pixels, and the functions from states to pixels and back.
export function view(width = byId("plane").clientWidth, height = byId("plane").clientHeight) {
  const x0 = MARGIN.left, x1 = width - MARGIN.right, x = (x0 + x1) / 2;
  const y0 = MARGIN.top, y1 = height - MARGIN.bottom, y = (y0 + y1) / 2;
  const scale = Math.max(Math.min(x1 - x0, y1 - y0), 1) / (2 * state.extent);
  const at = ([u, v]) => [x + u * scale, y - v * scale];
  const from = (px, py) => [(px - x) / scale, (y - py) / scale];
  return { x0, x1, y0, y1, scale, at, from };
}

export function drawPlane() {
  const { pen, width, height } = surface(byId("plane"));
  byId("legend-line").hidden = !state.scene?.line;
  paintPlane(pen, width, height);
}

// Draws on a canvas or an SvgPen; with `moving`, also the state of the body in space.
export function paintPlane(pen, width, height, moving = true) {
  const frame = view(width, height), { at, scale, x0, x1, y0, y1 } = frame;
  const labels = paintGrid(pen, frame);
  pen.save();
  pen.beginPath();
  pen.rect(x0, y0, x1 - x0, y1 - y0);
  pen.clip();
  if (state.scene) {
    if (state.shown.has("portrait")) paintPortrait(pen, at);
    paintLevels(pen, at);
    paintLine(pen, at, (2 * Math.hypot(width, height)) / scale);
    paintOrbit(pen, at, moving);
  }
  pen.restore();
  stroke(pen, [[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]], colours.axis, 1);
  for (const label of labels) write(pen, ...label);
}

const placed = (rows, at) => rows.map((row) => row && at(row));

function paintPortrait(pen, at) {
  const { levels, orbits } = state.scene.portrait ?? { levels: [], orbits: [] };
  for (const branch of levels) stroke(pen, placed(branch, at), colours.level, 1);
  for (const point of orbits.flat()) if (point) disc(pen, at(point), 1.5, colours.faint);
}

// A thin dashed line over a wide band, so that both are seen where the levels coincide.
function paintLevels(pen, at) {
  const { F, energy } = state.scene.levels;
  if (state.shown.has("F")) for (const branch of F) stroke(pen, placed(branch, at), colours.F, 6);
  if (state.shown.has("energy")) stroke(pen, placed(energy, at), colours.energy, 1.5, [7, 5]);
}

function paintLine(pen, at, far) {
  if (!state.scene.line) return;
  const [[u, v], [du, dv]] = state.scene.line; // the least steady state, and the direction of the repelling half
  for (const [way, dash] of [[far, [8, 6]], [-far, []]])
    stroke(pen, [at([u, v]), at([u + way * du, v + way * dv])], colours.line, 2.6, dash);
}

function paintOrbit(pen, at, moving) {
  const { omega, flow, parameters, status } = state.scene;
  const states = placed(omega, at), end = last(), now = states[state.moment];
  if (state.shown.has("joined")) stroke(pen, states, colours.faint, 1, [1, 4]);
  if (state.shown.has("flow")) for (const row of flow) if (row) disc(pen, at(row), 4, null, colours.flow);
  const radius = end > 800 ? 1.8 : end > 300 ? 2.2 : 2.8;
  for (let n = end; n >= 0; n--) if (states[n]) disc(pen, states[n], radius, colours.state);
  if (moving && now) {
    disc(pen, now, 5.5, colours.panel, colours.text);
    disc(pen, now, 3, colours.text);
  }
  const start = at([parameters.Omega1, parameters.Omega2]);
  disc(pen, start, 8, null, colours.accent);
  disc(pen, start, 9.5, null, colours.panel);
  disc(pen, start, 3, colours.accent);
  if (status.failed_at !== null && states[end]) paintCross(pen, states[end]);
}

// Marks the last state of an orbit that meets a pole.
export function paintCross(pen, [x, y]) {
  const cross = [[x - 10, y - 10], [x + 10, y + 10], null, [x - 10, y + 10], [x + 10, y - 10]];
  stroke(pen, cross, colours.panel, 7);
  stroke(pen, cross, colours.bad, 3.2);
}

// Returns a round distance of grid lines, at least `about`, and how their values are written.
export function grid(about) {
  const power = 10 ** Math.floor(Math.log10(about));
  const step = power * [1, 2, 5, 10].find((each) => each * power >= about);
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const far = Math.abs(Math.log10(step)) > 4;
  const named = (value) => (far ? value.toExponential(1) : value.toFixed(digits)).replaceAll("-", "−");
  return { step, named };
}

// Draws the grid lines, and returns the labels, which lie outside the clipped frame.
function paintGrid(pen, { x0, x1, y0, y1, scale, at, from }) {
  const { step, named } = grid(Math.min(70, (y1 - y0) / 5) / scale);
  const [left, top] = from(x0, y0), [right, bottom] = from(x1, y1);
  const labels = [["Ω₁", (x0 + x1) / 2, y1 + 30, { font: MATH }], ["Ω₂", x0, y0 - 8, { font: MATH }]];
  for (let k = Math.ceil(left / step); k * step <= right; k++) {
    const [x] = at([k * step, 0]);
    stroke(pen, [[x, y0], [x, y1]], k ? colours.grid : colours.axis, 1);
    labels.push([named(k * step), x, y1 + 15]);
  }
  for (let k = Math.ceil(bottom / step); k * step <= top; k++) {
    const [, y] = at([0, k * step]);
    stroke(pen, [[x0, y], [x1, y]], k ? colours.grid : colours.axis, 1);
    labels.push([named(k * step), x0 - 6, y + 4, { align: "right" }]);
  }
  return labels;
}

// Returns the extent that shows all states.
export function reach() {
  const { scene, shown } = state;
  const rows = [scene.omega, shown.has("flow") ? scene.flow : [], scene.numbers.omega_minus,
    scene.numbers.omega_plus].flat(2).filter(Number.isFinite);
  return 1.15 * rows.reduce((most, each) => Math.max(most, Math.abs(each)), 0);
}
