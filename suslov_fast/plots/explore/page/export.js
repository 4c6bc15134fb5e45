// Files and the clipboard: the figure as PNG or SVG, the orbit as CSV, the link, Python code.

import { colours } from "./pen.js";
import { byId, query, state } from "./state.js";

// `alone` returns the figure, { width, height, paint }; `csv` the text of the orbits.
export function buildExport({ alone, csv }) {
  const menu = byId("export");
  const on = (id, action) => byId(id).addEventListener("click", () => state.scene && action());
  on("save-png", () => savePng(alone()));
  on("save-svg", () => save("svg", new Blob([svg(alone())], { type: "image/svg+xml" })));
  on("save-csv", () => save("csv", new Blob([csv()], { type: "text/csv" })));
  on("copy-python", () => copy(state.scene.python, "Python copied"));
  on("copy-link", () => copy(`${location.origin}/?${query()}`, "Link copied"));
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

function svg({ width, height, paint }) {
  const pen = new SvgPen();
  paint(pen);
  const size = `viewBox="0 0 ${width} ${height}" width="${width}" height="${height}"`;
  const look = 'stroke-linejoin="round" stroke-linecap="round"';
  const paper = `<path d="M0 0h${width}v${height}h${-width}z" fill="${colours.panel}"/>`;
  return (
    `<svg xmlns="http://www.w3.org/2000/svg" ${size} ${look}>` +
    `<desc>${escaped(state.scene.python)}</desc>${paper}${pen.parts.join("\n")}</svg>\n`
  );
}

function savePng({ width, height, paint }) {
  const ratio = 3;
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

// Copies a text by selecting it, because a frame in a notebook may copy nothing else.
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
