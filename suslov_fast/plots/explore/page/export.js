// Files and the clipboard: the figure as PNG or SVG, the orbit as CSV, the link, Python code.

import { MARGIN, paintCross, paintPlane } from "./plane.js";
import { colours, disc, stroke, write } from "./pen.js";
import { byId, query, short, state } from "./state.js";

export function buildExport(address) {
  const menu = byId("export");
  const on = (id, action) => byId(id).addEventListener("click", () => state.scene && action());
  on("save-png", savePng);
  on("save-svg", () => save("svg", new Blob([svg()], { type: "image/svg+xml" })));
  on("save-csv", () => save("csv", new Blob([csv()], { type: "text/csv" })));
  on("copy-python", () => copy(state.scene.python, "Python copied"));
  on("copy-link", () => copy(`${address}?${query()}`, "Link copied"));
  addEventListener("click", ({ target }) => {
    if (!menu.contains(target)) menu.open = false;
  });
  menu.addEventListener("keydown", ({ key }) => {
    if (key !== "Escape") return;
    menu.open = false;
    menu.firstElementChild.focus();
  });
}

// A substitute for a canvas that writes SVG, with the methods that this page uses.
class SvgPen {
  parts = [];
  path = "";
  dash = "";

  beginPath() { this.path = ""; }
  moveTo(x, y) { this.path += `M${round(x)} ${round(y)}`; }
  lineTo(x, y) { this.path += `L${round(x)} ${round(y)}`; }
  rect(x, y, width, height) { this.path += `M${x} ${y}h${width}v${height}h${-width}z`; }
  arc(x, y, r) {
    const half = (width) => `a${r} ${r} 0 1 0 ${width} 0`;
    this.path += `M${round(x - r)} ${round(y)}${half(2 * r)}${half(-2 * r)}`;
  }
  setLineDash(dash) { this.dash = dash.join(" "); }
  save() {}
  clip() {
    const frame = `<clipPath id="frame"><path d="${this.path}"/></clipPath>`;
    this.parts.push(`${frame}<g clip-path="url(#frame)">`);
  }
  restore() { this.parts.push("</g>"); }
  fill() { this.parts.push(`<path d="${this.path}" fill="${this.fillStyle}"/>`); }
  stroke() {
    const look = `fill="none" stroke="${this.strokeStyle}" stroke-width="${this.lineWidth}"`;
    const dash = this.dash && ` stroke-dasharray="${this.dash}"`;
    this.parts.push(`<path d="${this.path}" ${look}${dash}/>`);
  }
  strokeText() {}
  fillText(text, x, y) {
    const anchor = { left: "start", center: "middle", right: "end" }[this.textAlign];
    const look = `text-anchor="${anchor}" fill="${this.fillStyle}" style="font: ${this.font}"`;
    this.parts.push(`<text x="${round(x)}" y="${round(y)}" ${look}>${escaped(text)}</text>`);
  }
}

const round = (value) => Number(value.toFixed(2));
const ENTITIES = { "&": "&amp;", "<": "&lt;", ">": "&gt;" };
const escaped = (text) => text.replace(/[&<>]/g, (each) => ENTITIES[each]);

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
    N: p.steps, "Ω₁(0)": p.Omega1, "Ω₂(0)": p.Omega2, t: numbers.criticality };
  for (const [name, value] of Object.entries(named)) {
    const word = `${name} = ${short(value)}`;
    if (lines.at(-1).length + word.length > (width - 2 * MARGIN.left) / 6) lines.push("");
    lines[lines.length - 1] += (lines.at(-1) && ", ") + word;
  }
  return lines;
}

// Returns the plane as a complete figure, with the legend and the parameters below.
function alone() {
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

function svg() {
  const { width, height, paint } = alone(), pen = new SvgPen();
  paint(pen);
  const size = `viewBox="0 0 ${width} ${height}" width="${width}" height="${height}"`;
  const look = 'stroke-linejoin="round" stroke-linecap="round"';
  const paper = `<path d="M0 0h${width}v${height}h${-width}z" fill="${colours.panel}"/>`;
  return (
    `<svg xmlns="http://www.w3.org/2000/svg" ${size} ${look}>` +
    `<desc>${escaped(state.scene.python)}</desc>${paper}${pen.parts.join("\n")}</svg>\n`
  );
}

function savePng() {
  const { width, height, paint } = alone(), ratio = 3;
  const canvas = document.createElement("canvas");
  Object.assign(canvas, { width: ratio * width, height: ratio * height });
  const pen = canvas.getContext("2d");
  pen.scale(ratio, ratio);
  pen.fillStyle = colours.panel;
  pen.fillRect(0, 0, width, height);
  pen.lineJoin = pen.lineCap = "round";
  paint(pen);
  canvas.toBlob((blob) => save("png", blob));
}

// Returns the orbit with all digits, without states that do not exist.
function csv() {
  const { omega, parameters } = state.scene, lines = ["n,time,Omega1,Omega2"];
  omega.forEach((row, n) => row && lines.push([n, n * parameters.eps, ...row].join(",")));
  return `${lines.join("\n")}\n`;
}

function save(kind, blob) {
  const link = document.createElement("a");
  Object.assign(link, { href: URL.createObjectURL(blob), download: `suslov-orbit.${kind}` });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  tell(`Saved ${link.download}`);
}

async function copy(text, done) {
  try {
    await navigator.clipboard.writeText(text);
    tell(done);
  } catch {
    tell(copyBySelection(text) ? done : "Not allowed here: copy the address");
  }
}

// Copies a text by selecting it, because a sandboxed frame may copy nothing else.
function copyBySelection(text) {
  const area = document.createElement("textarea");
  area.value = text;
  area.className = "hidden";
  document.body.append(area);
  area.select();
  const copied = document.execCommand("copy");
  area.remove();
  return copied;
}

function tell(text) {
  byId("export").open = false;
  byId("copied").textContent = text;
  setTimeout(() => { byId("copied").textContent = ""; }, 2500);
}
