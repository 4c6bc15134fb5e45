// The plane as a figure of its own, with a legend and the parameters, and the orbit as a table.

import { MARGIN, paintCross, paintPlane } from "./plane.js";
import { colours, disc, stroke, write } from "./pen.js";
import { byId, short, state } from "./state.js";

// Returns the entries of the legend: a sample of each line or dot, and its meaning.
function legend() {
  const line = (colour, width, dash = []) => (pen, x, y) =>
    stroke(pen, [[x, y], [x + 22, y]], colour, width, dash);
  const dot = (radius, fill, edge) => (pen, x, y) => disc(pen, [x + 11, y], radius, fill, edge);
  const cross = (pen, x, y) => paintCross(pen, [x + 11, y]);
  const { levels, portrait, flow, line: steady, status } = state.scene;
  const shows = (name) => state.shown.has(name);
  return [
    [true, dot(2.8, colours.state), "states of the map"],
    [true, dot(5, null, colours.accent), "first state"],
    [shows("F") && levels.F.length, line(colours.F, 6), "level of F"],
    [shows("energy") && levels.energy.some(Boolean), line(colours.energy, 1.5, [7, 5]),
      "level of the energy"],
    [shows("flow") && flow.some(Boolean), dot(4, null, colours.flow), "continuous motion"],
    [shows("joined"), line(colours.faint, 1, [1, 4]), "join of the states"],
    [shows("portrait") && portrait, dot(1.5, colours.faint), "other orbits, and their levels"],
    [steady, line(colours.line, 2.6, [8, 6]), "repelling steady states"],
    [steady, line(colours.line, 2.6), "attracting steady states"],
    [status.failed_at !== null, cross, "last state before a pole"],
  ].filter(([there]) => there);
}

// Returns the parameters, in lines that fit into this width.
function caption(width) {
  const { parameters: p, numbers } = state.scene, lines = [""];
  const named = { "I₁": p.I1, "I₂": p.I2, "I₁₃": p.I13, "I₂₃": p.I23, k: p.k, "ε": p.eps,
    N: p.steps, "Ω₁(0)": p.Omega1, "Ω₂(0)": p.Omega2, criticality: numbers.criticality };
  for (const [name, value] of Object.entries(named)) {
    const word = `${name} = ${short(value)}`;
    if (lines.at(-1).length + word.length > (width - 2 * MARGIN.left) / 6) lines.push("");
    lines[lines.length - 1] += (lines.at(-1) && ", ") + word;
  }
  return lines;
}

// Returns the plane as a complete figure, with the legend and the parameters below.
export function alone() {
  const { clientWidth: width, clientHeight: height } = byId("plane");
  const rows = legend(), columns = width > 480 ? 2 : 1, lines = caption(width), ROW = 19;
  const below = height + 24 + ROW * Math.ceil(rows.length / columns);
  const left = { align: "left", colour: colours.text };
  const paint = (pen) => {
    paintPlane(pen, width, height, false);
    rows.forEach(([, sample, text], k) => {
      const x = MARGIN.left + ((k % columns) * width) / 2;
      const y = height + 14 + ROW * Math.floor(k / columns);
      sample(pen, x, y);
      write(pen, text, x + 30, y + 4, left);
    });
    lines.forEach((text, k) => write(pen, text, MARGIN.left, below + ROW * k, left));
  };
  return { width, height: below + ROW * lines.length, paint };
}

// Returns the orbit with all digits, without states that do not exist.
export function csv() {
  const { omega, parameters } = state.scene, lines = ["n,time,Omega1,Omega2"];
  omega.forEach((row, n) => row && lines.push([n, n * parameters.eps, ...row].join(",")));
  return `${lines.join("\n")}\n`;
}
