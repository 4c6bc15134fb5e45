// The plane of two components of a field: grid and orbits.

import { MATH, colours, disc, stroke, surface, write } from "./pen.js";
import { MARGIN, grid, paintCross } from "./plane.js";
import { byId, short, state } from "./state.js";

const LEFT = MARGIN.left + 10; // values such as −1.0e+5

// Returns the frame in pixels, the ends of the axes, and the functions between states and pixels.
export function view(width = byId("plane").clientWidth, height = byId("plane").clientHeight) {
  const x0 = LEFT, x1 = width - MARGIN.right, y0 = MARGIN.top, y1 = height - MARGIN.bottom;
  const box = (state.values.box || "-1,1,-1,1").split(",").map(Number), [l, r, b, t] = box;
  const at = ([u, v]) => [x0 + ((u - l) / (r - l)) * (x1 - x0), y1 - ((v - b) / (t - b)) * (y1 - y0)];
  const from = (px, py) => [l + ((px - x0) / (x1 - x0)) * (r - l), b + ((y1 - py) / (y1 - y0)) * (t - b)];
  return { x0, x1, y0, y1, box, at, from };
}

export const at = (point) => view().at(point);

// Returns the ends of the axes that show all states before a pole.
export function fitted() {
  const rows = state.scene.orbits.flatMap(({ states, valid }) => states.slice(0, valid)).filter(Boolean);
  return [0, 1].flatMap((k) => {
    let low = Infinity, high = -Infinity;
    for (const row of rows) {
      low = Math.min(low, row[k]);
      high = Math.max(high, row[k]);
    }
    if (!(low <= high)) [low, high] = [-1, 1];
    const margin = 0.06 * (high - low) || Math.abs(high) || 1;
    return [low - margin, high + margin];
  });
}

export function drawOrbits() {
  const { pen, width, height } = surface(byId("plane"));
  byId("legend-passed").hidden = !state.scene?.orbits.some((each) => each.first_pole >= 0);
  if (state.scene) paint(pen, width, height);
}

function paint(pen, width, height) {
  const frame = view(width, height), { x0, x1, y0, y1 } = frame;
  const labels = paintGrid(pen, frame);
  pen.save();
  pen.beginPath();
  pen.rect(x0, y0, x1 - x0, y1 - y0);
  pen.clip();
  const { orbits } = state.scene;
  orbits.forEach((orbit, k) => paintOrbit(pen, orbit, frame.at, k === orbits.length - 1));
  pen.restore();
  stroke(pen, [[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]], colours.axis, 1);
  for (const label of labels) write(pen, ...label);
}

// Draws the states before a pole in one colour, those after it in another, and the start on top.
function paintOrbit(pen, { states, valid, failed_at: failed }, at, isLast) {
  const points = states.map((row) => row && at(row)), colour = isLast ? colours.accent : colours.state;
  const before = points.slice(0, valid), after = points.slice(Math.max(valid - 1, 0));
  if (byId("joined").checked) {
    stroke(pen, before, colour, 1.2);
    stroke(pen, after, colours.bad, 1, [1, 4]);
  }
  if (byId("dots").checked || !byId("joined").checked)
    points.forEach((point, n) => point && disc(pen, point, 1.7, n < valid ? colour : colours.bad));
  if (points[0]) {
    disc(pen, points[0], isLast ? 6.5 : 4.5, null, colour);
    disc(pen, points[0], isLast ? 3 : 2, colour);
  }
  if (failed !== null && points[failed - 1]) paintCross(pen, points[failed - 1]);
}

// Draws the grid lines, and returns the labels, which lie outside the clipped frame.
function paintGrid(pen, { x0, x1, y0, y1, box, at }) {
  const { x, y } = state.scene.parameters, [l, r, b, t] = box;
  const labels = [[x, (x0 + x1) / 2, y1 + 30, { font: MATH }],
    [y, x0, y0 - 8, { font: MATH, align: "left" }]];
  const across = grid((55 / (x1 - x0)) * (r - l)), up = grid((60 / (y1 - y0)) * (t - b));
  for (let k = Math.ceil(l / across.step); k * across.step <= r; k++) {
    const [px] = at([k * across.step, b]);
    stroke(pen, [[px, y0], [px, y1]], k ? colours.grid : colours.axis, 1);
    labels.push([across.named(k * across.step), px, y1 + 15]);
  }
  for (let k = Math.ceil(b / up.step); k * up.step <= t; k++) {
    const [, py] = at([l, k * up.step]);
    stroke(pen, [[x0, py], [x1, py]], k ? colours.grid : colours.axis, 1);
    labels.push([up.named(k * up.step), x0 - 6, py + 4, { align: "right" }]);
  }
  return labels;
}

// Returns the plane as a figure, with the step and the method, or time and tolerance, below.
export function alone() {
  const { clientWidth: width, clientHeight: height } = byId("plane");
  const { parameters: { method }, values, said } = state.scene;
  const named = Object.entries({ ...values, ...said }).map(([name, value]) => `${name} = ${short(value)}`);
  const text = [...named, ...(method ? [method] : [])].join(", ");
  const paintAll = (pen) => {
    paint(pen, width, height);
    write(pen, text, LEFT, height + 16, { align: "left", colour: colours.text });
  };
  return { width, height: height + 26, paint: paintAll };
}

// Returns the two components of the orbits with all digits, without states that do not exist.
export function csv() {
  const { orbits, time, parameters: { x, y } } = state.scene, lines = [`orbit,n,time,${x},${y},valid`];
  orbits.forEach(({ states, valid }, k) => states.forEach((row, n) => {
    if (row) lines.push([k, n, time[n], ...row, Number(n < valid)].join(","));
  }));
  return `${lines.join("\n")}\n`;
}
