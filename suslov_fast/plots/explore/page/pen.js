// Lines, dots and text on a canvas, or on an SvgPen.

export const SMALL = "12px system-ui, 'DejaVu Sans', sans-serif";
export const MATH = "italic 15px Georgia, 'DejaVu Serif', serif";
export const colours = {};

const NAMES = "text faint panel edge grid axis accent line F energy flow omega bad state level";

// Reads the colours from the style sheet, which has others for dark mode.
export function readColours() {
  const style = getComputedStyle(document.documentElement);
  const read = (name) => style.getPropertyValue(`--${name}`).trim();
  const rgb = (code) => [1, 3, 5].map((k) => parseInt(code.slice(k, k + 2), 16));
  for (const name of NAMES.split(" ")) colours[name] = read(name);
  Object.assign(colours, { patches: [rgb(read("body-other")), rgb(read("body"))] });
}

// Clears a canvas, and returns its context in units of CSS pixels.
export function surface(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const { clientWidth: width, clientHeight: height } = canvas;
  const size = { width: Math.round(width * ratio), height: Math.round(height * ratio) };
  if (canvas.width !== size.width || canvas.height !== size.height) Object.assign(canvas, size);
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.lineJoin = pen.lineCap = "round";
  return { pen, width, height };
}

// Limits a coordinate to a range in which no browser overflows, far outside the canvas.
const clamp = (value) => Math.min(Math.max(value, -1e5), 1e5);

// Draws a line through points; null interrupts it.
export function stroke(pen, points, colour, width = 1.5, dash = []) {
  pen.beginPath();
  let open = false;
  for (const point of points) {
    if (point) pen[open ? "lineTo" : "moveTo"](clamp(point[0]), clamp(point[1]));
    open = Boolean(point);
  }
  Object.assign(pen, { strokeStyle: colour, lineWidth: width });
  pen.setLineDash(dash);
  pen.stroke();
  pen.setLineDash([]);
}

export function disc(pen, [x, y], radius, fill, edge = null) {
  if (Math.abs(x) > 1e4 || Math.abs(y) > 1e4) return;
  pen.beginPath();
  pen.arc(x, y, radius, 0, 2 * Math.PI);
  if (fill) {
    pen.fillStyle = fill;
    pen.fill();
  }
  if (edge) {
    Object.assign(pen, { strokeStyle: edge, lineWidth: 1.4 });
    pen.stroke();
  }
}

// Writes a text with a margin in the colour of the panel, so that lines may run behind it.
export function write(pen, text, x, y, { align = "center", font = SMALL, colour = colours.faint } = {}) {
  const margin = { strokeStyle: colours.panel, lineWidth: 4 };
  Object.assign(pen, { font, textAlign: align, fillStyle: colour }, margin);
  pen.strokeText(text, x, y);
  pen.fillText(text, x, y);
}
