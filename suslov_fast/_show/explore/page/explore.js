// Draws what the server computes: nothing of the problem is computed here.
"use strict";

const byId = (id) => document.getElementById(id);
const FIELDS = {
  I1: { html: "I<sub>1</sub>", min: 0.05, max: 10, step: 0.05, says: "I1, moment of inertia" },
  I2: { html: "I<sub>2</sub>", min: 0.05, max: 10, step: 0.05, says: "I2, moment of inertia" },
  I13: { html: "I<sub>13</sub>", min: -3, max: 3, step: 0.05, says: "I13, product of inertia" },
  I23: { html: "I<sub>23</sub>", min: -3, max: 3, step: 0.05, says: "I23, product of inertia" },
  k: { html: "k", min: -3, max: 3, step: 0.05, says: "k, momentum of a rotor along the axis a" },
  eps: { html: "ε", min: -2, max: 2, step: 0.01, says: "epsilon, step size" },
  steps: { html: "N", min: 1, max: 2000, step: 1, says: "N, number of steps" },
  Omega1: { html: "Ω<sub>1</sub>", min: -4, max: 4, step: 0.01, says: "Omega1 at the start" },
  Omega2: { html: "Ω<sub>2</sub>", min: -4, max: 4, step: 0.01, says: "Omega2 at the start" },
};
const SHOWN = ["F", "energy"];
const MARGIN = { left: 46, right: 12, top: 24, bottom: 34 };
const SMALL = "12px system-ui, 'DejaVu Sans', sans-serif";
const MATH = "italic 15px Georgia, 'DejaVu Serif', serif";
const values = {}; // texts of the fields: a wrong value stays as the user wrote it
const inputs = {};
const LOST = "suslov-fast does not answer: start it again and reload this page.";
let settings, scene = null;
let extent = 4, shown = new Set(SHOWN), moment = 0, share = 0, playing = false, colours = {};
let camera = { turn: -0.7, lift: 0.42 };

// ---------------------------------------------------------------- talking to the server

let asking = false, again = false;

async function ask() {
  if (asking) { again = true; return; }
  asking = true;
  const begun = Date.now();
  const waiting = setInterval(() => {
    const seconds = Math.round((Date.now() - begun) / 1000);
    say(`Compiling the kernels, once per installation. ${seconds} s`, true);
  }, 1000);
  try {
    const reply = await fetch("/scene?" + new URLSearchParams(
      { ...values, extent, portrait: Number(shown.has("portrait")) }));
    const found = await reply.json();
    clearInterval(waiting);
    if (found.error) complain(found.error, found.fields);
    else receive(found);
  } catch {
    clearInterval(waiting);
    complain(LOST);
  }
  asking = false;
  if (again) { again = false; ask(); }
}

function receive(found) {
  const length = scene ? scene.omega.length : 0;
  scene = found;
  say("");
  mark([]);
  document.body.classList.remove("stale");
  byId("moment").max = last();
  if (moment > last() || found.omega.length !== length) setMoment(Math.min(moment, last()));
  else setMoment(moment);
  describe();
  draw();
  document.documentElement.dataset.ready = String(Number(document.documentElement.dataset.ready || 0) + 1);
}

function complain(message, fields = []) {
  say(message);
  mark(fields);
  document.body.classList.add("stale");
  // What stands there is about other values.
  for (const id of ["status", "regime-text", "failure"]) byId(id).textContent = "";
  byId("regime-name").textContent = "No orbit";
}

function say(message, waiting = false) {
  const place = byId("message");
  place.textContent = message;
  place.hidden = !message;
  place.classList.toggle("waiting", waiting);
}

function mark(fields) {
  for (const [name, { number }] of Object.entries(inputs)) {
    number.parentElement.classList.toggle("wrong", fields.includes(name));
    number.toggleAttribute("aria-invalid", fields.includes(name));
  }
}

// The last state that exists.
function last() {
  const missing = scene.omega.indexOf(null);
  return missing < 0 ? scene.omega.length - 1 : Math.max(missing - 1, 0);
}

// ---------------------------------------------------------------- parameters

function build() {
  for (const set of document.querySelectorAll("fieldset[data-fields]")) {
    for (const name of set.dataset.fields.split(" ")) {
      const { html, min, max, step, says } = FIELDS[name];
      const row = document.createElement("div");
      row.className = "field";
      row.innerHTML = `<label for="${name}" title="${says}">${html}</label>` +
        `<input type="range" id="${name}-slider" aria-label="${says}, slider" min="${min}" max="${max}" step="${step}">` +
        `<input type="number" id="${name}" aria-label="${says}" step="${step}">`;
      set.append(row);
      const [slider, number] = row.querySelectorAll("input");
      inputs[name] = { slider, number };
      slider.addEventListener("input", () => change({ [name]: slider.value }));
      number.addEventListener("input", () => change({ [name]: number.value }, name));
    }
  }
  for (const box of document.querySelectorAll("#show input")) {
    box.addEventListener("change", () => {
      if (box.checked) shown.add(box.value); else shown.delete(box.value);
      remember();
      if (box.value === "portrait") ask();
      draw();
    });
  }
  byId("controls").addEventListener("submit", (event) => event.preventDefault());
}

function change(changes, typed = null) {
  for (const [name, value] of Object.entries(changes)) {
    values[name] = String(value);
    inputs[name].slider.value = values[name];
    if (name !== typed) inputs[name].number.value = values[name];
  }
  name();
  remember();
  ask();
}

// Select the preset that has these values, if there is one.
function name() {
  const same = ({ parameters }) => Object.keys(FIELDS).every((field) => Number(values[field]) === parameters[field]);
  byId("preset").value = settings.presets.find(same)?.name ?? "";
}

// Sliders of the start reach as far as the plane does.
function setExtent(value) {
  extent = Math.min(Math.max(value, 1e-12), 1e12);
  const step = 10 ** Math.floor(Math.log10(extent / 200));
  for (const name of ["Omega1", "Omega2"]) {
    Object.assign(inputs[name].slider, { min: -extent, max: extent, step: "any" });
    inputs[name].slider.value = values[name];
    inputs[name].number.step = step;
  }
  remember();
  if (shown.has("portrait") && scene) ask();
}

let remembering = null;
function remember() {
  // Browsers refuse a page that changes its address at every move of the mouse.
  clearTimeout(remembering);
  remembering = setTimeout(() => history.replaceState(null, "", "?" + query()), 150);
}

const query = () => new URLSearchParams({ ...values, extent: short(extent, 6), show: [...shown].join(" ") }).toString();

function choose(preset) {
  for (const name of Object.keys(values)) delete values[name];
  for (const [name, value] of Object.entries(preset.parameters)) {
    if (value === undefined || name === "extent" || name === "portrait") continue;
    values[name] = String(value);
    if (name in inputs) inputs[name].slider.value = inputs[name].number.value = values[name];
  }
  name();
  setExtent(preset.parameters.extent);
  setMoment(0);
  ask();
}

// A number as it is usually written; anything else as it is.
const tidy = (text) => text && Number.isFinite(Number(text)) ? String(Number(text)) : text;

function fromAddress() {
  const given = new URLSearchParams(location.search);
  const first = settings.presets[0];
  if (given.has("show")) shown = new Set(given.get("show").split(" ").filter(Boolean));
  const extent = Number(given.get("extent")) || first.parameters.extent;
  for (const name of ["show", "extent", "portrait"]) given.delete(name);
  // An address that has some parameters and not others is refused by the server, in its words.
  const parameters = given.size ? { k: "0", ...Object.fromEntries(given) } : { ...first.parameters };
  for (const name of Object.keys(parameters)) parameters[name] = tidy(parameters[name]);
  choose({ parameters: { ...parameters, extent } });
  for (const box of document.querySelectorAll("#show input")) box.checked = shown.has(box.value);
}

// ---------------------------------------------------------------- words and numbers

function short(value, digits = 6) {
  if (value === null) return "none";
  const text = Number(value.toPrecision(digits)).toString();
  return text.replaceAll("-", "−");
}

const pair = (values) => values ? `(${values.map((each) => short(each, 5)).join(", ")})` : "none";

function describe() {
  const { numbers, regime, status, ellipsoid } = scene;
  const t = numbers.criticality;
  const t1 = Math.abs(t), size = t < 0 ? "|t|" : "t";
  byId("regime-name").textContent = { steady: "Steady rotation", still: "No motion: ε = 0", unknown: "Beyond float64" }[regime.name]
    ?? `${size} = ${short(t1, 5)}${t1 === 1 ? "" : t1 < 1 ? " < 1" : " > 1"}`;
  byId("regime-text").textContent = regime.text;
  byId("gauge").value = t === null ? 2 : Math.abs(t);
  byId("gauge").textContent = short(t);
  const badge = byId("status");
  badge.textContent = badge.dataset.status = status.name;
  badge.title = status.message;
  byId("failure").textContent = status.failed_at === null ? ""
    : `No state ${status.failed_at}: ${status.message}.`;
  const rows = [
    ["criticality t", short(t)],
    ["F", short(numbers.F)],
    ["largest change of F", numbers.drift ? numbers.drift.toExponential(1).replace("-", "−") : short(numbers.drift)],
    ["energy", short(numbers.energy)],
    ["limit n → −∞", pair(numbers.omega_minus)],
    ["limit n → +∞", pair(numbers.omega_plus)],
    ["scattering angle", numbers.scattering_angle === null ? "none" : `${short(numbers.scattering_angle * 180 / Math.PI, 5)}°`],
    ["I₃ of a rigid body", numbers.I3 ? numbers.I3.map((each) => short(each, 4)).join(" to ") : "none"],
  ];
  byId("numbers").replaceChildren(...rows.flatMap(([name, value]) => {
    const term = document.createElement("dt"), text = document.createElement("dd");
    term.textContent = name;
    text.textContent = value;
    return [term, text];
  }));
  byId("matter").textContent = ellipsoid === null ? ""
    : `Ellipsoid of inertia with I₃ = ${short(ellipsoid.I3, 4)}` +
      (ellipsoid.matter ? "." : ". No rigid body has these parameters.");
}

// ---------------------------------------------------------------- the plane

function surface(canvas) {
  const ratio = window.devicePixelRatio || 1, { clientWidth: width, clientHeight: height } = canvas;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.lineJoin = pen.lineCap = "round";
  return { pen, width, height };
}

// The plane in a picture of so many pixels: its frame, and where points lie in it.
function view({ width, height } = { width: byId("plane").clientWidth, height: byId("plane").clientHeight }) {
  const x0 = MARGIN.left, x1 = width - MARGIN.right, y0 = MARGIN.top, y1 = height - MARGIN.bottom;
  const scale = Math.max(Math.min(x1 - x0, y1 - y0), 1) / (2 * extent), x = (x0 + x1) / 2, y = (y0 + y1) / 2;
  return { x0, x1, y0, y1, scale,
    at: ([u, v]) => [x + u * scale, y - v * scale],
    from: (px, py) => [(px - x) / scale, (y - py) / scale] };
}

// Far outside the canvas, where lines still lead but no browser overflows.
const clamp = (value) => Math.min(Math.max(value, -1e5), 1e5);

function stroke(pen, points, colour, width = 1.5, dash = []) {
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

function disc(pen, [x, y], radius, fill, edge = null) {
  if (Math.abs(x) > 1e4 || Math.abs(y) > 1e4) return;
  pen.beginPath();
  pen.arc(x, y, radius, 0, 2 * Math.PI);
  if (fill) { pen.fillStyle = fill; pen.fill(); }
  if (edge) { Object.assign(pen, { strokeStyle: edge, lineWidth: 1.4 }); pen.stroke(); }
}

// Text with a margin, so that lines may run behind it.
function write(pen, text, x, y, align = "center", font = SMALL, colour = colours.faint) {
  Object.assign(pen, { font, textAlign: align, strokeStyle: colours.panel, lineWidth: 4, fillStyle: colour });
  pen.strokeText(text, x, y);
  pen.fillText(text, x, y);
}

function drawPlane() {
  const { pen, width, height } = surface(byId("plane"));
  byId("legend-line").hidden = !scene?.line;
  paintPlane(pen, width, height);
}

// Draws with a canvas or with an SvgPen.
function paintPlane(pen, width, height, moving = true) {
  const frame = view({ width, height }), { at, scale, x0, x1, y0, y1 } = frame;
  const labels = drawGrid(pen, frame);
  pen.save();
  pen.beginPath();
  pen.rect(x0, y0, x1 - x0, y1 - y0);
  pen.clip();
  if (scene) paintScene(pen, at, 2 * Math.hypot(width, height) / scale, moving);
  pen.restore();
  stroke(pen, [[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]], colours.axis, 1);
  for (const label of labels) write(pen, ...label);
}

function paintScene(pen, at, far, moving) {
  const place = (row) => row && at(row);
  if (shown.has("portrait") && scene.portrait) {
    for (const branch of scene.portrait.levels) stroke(pen, branch.map(place), colours.level, 1);
    for (const orbit of scene.portrait.orbits) for (const row of orbit) if (row) disc(pen, at(row), 1.5, colours.faint);
  }
  // A wide band under a thin dashed line: both are seen where the two levels coincide.
  if (shown.has("F")) for (const branch of scene.levels.F) stroke(pen, branch.map(place), colours.F, 6);
  if (shown.has("energy")) stroke(pen, scene.levels.energy.map(place), colours.energy, 1.5, [7, 5]);
  if (scene.line) for (const [half, dash] of [["repelling", [8, 6]], ["attracting", []]])
    stroke(pen, [at(scene.line.middle), at(scene.line[half].map((each, k) => each * far + scene.line.middle[k]))], colours.line, 2.6, dash);
  const states = scene.omega.map(place), end = last();
  if (shown.has("joined")) stroke(pen, states, colours.faint, 1, [1, 4]);
  if (shown.has("flow")) for (const row of scene.flow) if (row) disc(pen, at(row), 4, null, colours.flow);
  const radius = end > 800 ? 1.8 : end > 300 ? 2.2 : 2.8;
  for (let n = end; n >= 0; n--) if (states[n]) disc(pen, states[n], radius, colours.state);
  if (moving && states[moment]) disc(pen, states[moment], 5.5, colours.panel, colours.text);
  if (moving && states[moment]) disc(pen, states[moment], 3, colours.text);
  const start = at([scene.parameters.Omega1, scene.parameters.Omega2]);
  disc(pen, start, 8, null, colours.accent);
  disc(pen, start, 9.5, null, colours.panel);
  disc(pen, start, 3, colours.accent);
  if (scene.status.failed_at !== null && states[end]) drawCross(pen, states[end]);
}

// The last state of an orbit that meets a pole.
function drawCross(pen, [x, y]) {
  for (const [colour, width] of [[colours.panel, 7], [colours.bad, 3.2]])
    stroke(pen, [[x - 10, y - 10], [x + 10, y + 10], null, [x - 10, y + 10], [x + 10, y - 10]], colour, width);
}

// Grid lines; returns the labels, which stand outside the frame.
function drawGrid(pen, { x0, x1, y0, y1, scale, at, from }) {
  const about = 70 / scale, power = 10 ** Math.floor(Math.log10(about));
  const step = power * [1, 2, 5, 10].find((each) => each * power >= about);
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const named = (value) => (Math.abs(Math.log10(step)) > 4 ? value.toExponential(1) : value.toFixed(digits)).replaceAll("-", "−");
  const labels = [], [left, top] = from(x0, y0), [right, bottom] = from(x1, y1);
  for (let k = Math.ceil(left / step); k * step <= right; k++) {
    const [x] = at([k * step, 0]);
    stroke(pen, [[x, y0], [x, y1]], k ? colours.grid : colours.axis, 1);
    labels.push([named(k * step), x, y1 + 15, "center", SMALL]);
  }
  for (let k = Math.ceil(bottom / step); k * step <= top; k++) {
    const [, y] = at([0, k * step]);
    stroke(pen, [[x0, y], [x1, y]], k ? colours.grid : colours.axis, 1);
    labels.push([named(k * step), x0 - 6, y + 4, "right", SMALL]);
  }
  return [...labels, ["Ω₁", (x0 + x1) / 2, y1 + 30, "center", MATH], ["Ω₂", x0, y0 - 8, "center", MATH]];
}

// Puts the start at the pointer, with as many digits as a pixel resolves.
function moveStart(px, py) {
  const digits = Math.max(0, Math.ceil(-Math.log10(1 / view().scale)) + 1);
  const [x, y] = view().from(px, py).map((each) => Number(each.toFixed(Math.min(digits, 20))));
  change({ Omega1: x, Omega2: y });
}

function zoom(factor) {
  setExtent(extent * factor);
  drawPlane();
}

function fit() {
  if (!scene) return;
  const rows = [...scene.omega, shown.has("flow") ? scene.flow : []].flat(2).filter(Number.isFinite);
  const limits = [scene.numbers.omega_minus, scene.numbers.omega_plus].flat().filter(Number.isFinite);
  const largest = Math.max(...rows.map(Math.abs), ...limits.map(Math.abs));
  if (largest > 0) setExtent(1.15 * largest);
  drawPlane();
}

// ---------------------------------------------------------------- the body in space

const times = (R, v) => [0, 1, 2].map((i) => R[3 * i] * v[0] + R[3 * i + 1] * v[1] + R[3 * i + 2] * v[2]);
const dot = (u, v) => u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
const scaled = (v, factor) => v.map((each) => each * factor);
const AXES = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
const AROUND = 32, ALONG = 16, TIP = 1.3, TRAIL = 40, ARCS = 24;

// What is seen from a camera that looks at the origin: to the right, up, towards the eye.
function seen([x, y, z]) {
  const { turn, lift } = camera;
  const right = -Math.sin(turn) * x + Math.cos(turn) * y;
  const away = Math.cos(turn) * x + Math.sin(turn) * y;
  return [right, Math.cos(lift) * z - Math.sin(lift) * away, Math.cos(lift) * away + Math.sin(lift) * z];
}

function drawSpace() {
  const { pen, width, height } = surface(byId("space"));
  if (!scene) return;
  const scale = Math.min(width, height) / 3.25;
  const at = ([right, up]) => [width / 2 + right * scale, height / 2 - up * scale];
  const R = orientation(moment, share);
  if (!R) return;
  const ring = [];
  for (let k = 0; k <= 90; k++) ring.push(at(seen([TIP * Math.cos(k * Math.PI / 45), TIP * Math.sin(k * Math.PI / 45), 0])));
  stroke(pen, ring, colours.edge, 1);

  const path = trail().map((axis) => seen(scaled(axis, TIP)));
  const half = (front) => (points) => points.map((each, k) => (each[2] > 0) === front || (k && (points[k - 1][2] > 0) === front) ? at(each) : null);
  const axes = AXES.map((axis, k) => ({ tip: seen(scaled(times(R, axis), TIP)), name: ["e₁", "e₂", "a"][k], colour: k === 2 ? colours.line : colours.text }));
  const velocity = scene.spatial[Math.min(moment, last())];
  const most = Math.max(...scene.spatial.map((each) => each ? Math.hypot(...each) : 0));
  byId("legend-omega").hidden = !(velocity && most > 0);
  if (velocity) {
    if (most > 0) axes.push({ tip: seen(scaled(velocity, TIP / most)), name: "Ω", colour: colours.omega });
  }
  for (const front of [false, true]) {
    if (front) drawEllipsoid(pen, at, R, scale);
    pen.globalAlpha = front ? 1 : 0.45;
    stroke(pen, half(front)(path), colours.line, 1.6);
    pen.globalAlpha = 1;
    for (const { tip, name, colour } of axes) if ((tip[2] > 0) === front) drawArrow(pen, at, tip, name, colour, front, R);
  }
}

function drawArrow(pen, at, tip, name, colour, front, R) {
  // In front of the body an arrow is seen from where it leaves the body.
  const from = front ? scaled(tip, Math.min(1, leaving(tip, R) / Math.max(Math.hypot(...tip), 1e-9))) : [0, 0, 0];
  stroke(pen, [at(from), at(tip)], colour, 2.4);
  disc(pen, at(tip), 3.2, colour);
  const [x, y] = at(tip), [x0, y0] = at([0, 0]), far = Math.max(Math.hypot(x - x0, y - y0), 1);
  write(pen, name, x + 14 * (x - x0) / far, y + 14 * (y - y0) / far + 5, "center", MATH, colour);
}

// The orientation at a state and, to draw what lies between, a share of the one turn to the next:
// in a step the body turns by less than half a turn, about one axis.
function orientation(n, part) {
  const R = scene.attitude[Math.min(n, last())], S = scene.attitude[n + 1];
  if (!R || !S || !part) return R;
  const turn = (i, j) => R[i] * S[j] + R[3 + i] * S[3 + j] + R[6 + i] * S[6 + j];
  const axis = [turn(2, 1) - turn(1, 2), turn(0, 2) - turn(2, 0), turn(1, 0) - turn(0, 1)];
  const sine = Math.hypot(...axis) / 2, cosine = (turn(0, 0) + turn(1, 1) + turn(2, 2) - 1) / 2;
  if (sine < 1e-9) return R;
  const [x, y, z] = scaled(axis, 0.5 / sine), angle = part * Math.atan2(sine, cosine);
  const c = Math.cos(angle), s = Math.sin(angle), d = 1 - c;
  const T = [[c + d * x * x, d * x * y - s * z, d * x * z + s * y],
    [d * x * y + s * z, c + d * y * y, d * y * z - s * x],
    [d * x * z - s * y, d * y * z + s * x, c + d * z * z]];
  return [0, 1, 2].flatMap((i) => [0, 1, 2].map((j) => R[3 * i] * T[0][j] + R[3 * i + 1] * T[1][j] + R[3 * i + 2] * T[2][j]));
}

// Where the axis a has been: the last steps, as the arcs that it turned along.
function trail() {
  const points = [], first = Math.max(0, moment - TRAIL);
  for (let n = first; n <= moment; n++) {
    const parts = n < moment ? ARCS : Math.floor(share * ARCS) + 1;
    for (let k = 0; k < parts; k++) points.push(orientation(n, k / ARCS));
  }
  points.push(orientation(moment, share));
  return points.filter(Boolean).map((R) => [R[2], R[5], R[8]]);
}

// How far from the origin the drawn ellipsoid reaches in a direction on the screen.
function leaving(tip, R) {
  if (!scene.ellipsoid) return 0;
  const length = Math.hypot(...tip) || 1, { radii, axes } = scene.ellipsoid;
  let sum = 0;
  for (let k = 0; k < 3; k++) {
    const part = dot(seen(times(R, axes.map((row) => row[k]))), tip) / length / radii[k];
    sum += part * part;
  }
  return 1 / Math.sqrt(sum);
}

function drawEllipsoid(pen, at, R) {
  if (!scene.ellipsoid) return;
  const { radii, axes } = scene.ellipsoid;
  const frame = [0, 1, 2].map((k) => seen(times(R, axes.map((row) => row[k]))));
  const point = (parts) => [0, 1, 2].map((i) => frame[0][i] * parts[0] + frame[1][i] * parts[1] + frame[2][i] * parts[2]);
  const sphere = (i, j) => {
    const u = 2 * Math.PI * i / AROUND, v = Math.PI * j / ALONG;
    return [Math.cos(u) * Math.sin(v), Math.sin(u) * Math.sin(v), Math.cos(v)];
  };
  const corners = [];
  for (let j = 0; j <= ALONG; j++)
    for (let i = 0; i < AROUND; i++) corners.push(at(point(sphere(i, j).map((each, k) => each * radii[k]))));
  for (let j = 0; j < ALONG; j++) {
    for (let i = 0; i < AROUND; i++) {
      const normal = point(sphere(i + 0.5, j + 0.5).map((each, k) => each / radii[k]));
      if (normal[2] <= 0) continue; // convex: what faces the eye hides the rest
      const size = Math.hypot(...normal);
      const light = Math.max(0, (0.35 * normal[0] + 0.5 * normal[1] + 0.8 * normal[2]) / size);
      const patch = (Math.floor(i / 4) + Math.floor(j / 4)) % 2 ? colours.bodyRgb : colours.bodyOtherRgb;
      const shade = patch.map((each) => Math.round(Math.min(255, each * (0.5 + 0.62 * light))));
      const next = (i + 1) % AROUND;
      pen.beginPath();
      for (const [a, b] of [[i, j], [next, j], [next, j + 1], [i, j + 1]]) pen.lineTo(...corners[b * AROUND + a]);
      pen.closePath();
      pen.fillStyle = pen.strokeStyle = `rgb(${shade.join(" ")})`;
      pen.lineWidth = 0.7;
      pen.fill();
      pen.stroke();
    }
  }
}

// ---------------------------------------------------------------- time

function setMoment(n) {
  moment = n;
  share = 0;
  byId("moment").value = n;
  byId("moment-value").value = `n = ${n}`;
}

function play(on) {
  playing = on;
  byId("play").textContent = on ? "Pause" : "Play";
  byId("play").setAttribute("aria-pressed", String(on));
  if (on) {
    if (scene && moment >= last()) setMoment(0);
    before = null;
    requestAnimationFrame(tick);
  }
}

let before = null, resting = 0;

function tick(now) {
  if (!playing) return;
  if (before !== null && scene) {
    const seconds = Math.min(now - before, 200) / 1000, speed = Number(byId("speed").value);
    if (moment >= last()) {
      // It rests at the end before it begins anew.
      resting += seconds;
      if (resting > 1) setMoment(0);
    } else {
      resting = 0;
      const reached = Math.min(moment + share + seconds * speed, last()), whole = Math.floor(reached);
      if (whole !== moment) setMoment(whole);
      share = reached - whole;
    }
    draw();
  }
  before = now;
  requestAnimationFrame(tick);
}

// ---------------------------------------------------------------- drawing, and what leads to it

function draw() {
  drawPlane();
  drawSpace();
}

function readColours() {
  const style = getComputedStyle(document.documentElement);
  for (const name of ["text", "faint", "panel", "edge", "grid", "axis", "accent", "line", "F", "energy", "flow", "omega", "bad", "state", "level"])
    colours[name] = style.getPropertyValue(`--${name}`).trim();
  const rgb = (name) => {
    const code = style.getPropertyValue(`--${name}`).trim();
    return [1, 3, 5].map((k) => parseInt(code.slice(k, k + 2), 16));
  };
  Object.assign(colours, { bodyRgb: rgb("body"), bodyOtherRgb: rgb("body-other") });
}

function arrows(event) {
  const direction = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
  if (direction) event.preventDefault();
  return direction;
}

function listen() {
  const plane = byId("plane"), space = byId("space");
  plane.addEventListener("pointerdown", (event) => {
    plane.setPointerCapture(event.pointerId);
    moveStart(event.offsetX, event.offsetY);
  });
  plane.addEventListener("pointermove", (event) => {
    if (plane.hasPointerCapture(event.pointerId)) moveStart(event.offsetX, event.offsetY);
  });
  plane.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(Math.exp(event.deltaY * 0.0012));
  }, { passive: false });
  plane.addEventListener("keydown", (event) => {
    const direction = arrows(event);
    if (direction) {
      const pixels = event.shiftKey ? 20 : 2, [x, y] = view().at([Number(values.Omega1), Number(values.Omega2)]);
      moveStart(x + pixels * direction[0], y - pixels * direction[1]);
    } else if (event.key === "+" || event.key === "=") zoom(0.8);
    else if (event.key === "-") zoom(1.25);
    else if (event.key === "0") fit();
  });
  space.addEventListener("pointerdown", (event) => space.setPointerCapture(event.pointerId));
  space.addEventListener("pointermove", (event) => {
    if (space.hasPointerCapture(event.pointerId)) look(event.movementX * 0.01, event.movementY * 0.01);
  });
  space.addEventListener("keydown", (event) => {
    const direction = arrows(event);
    if (direction) look(0.1 * direction[0], -0.1 * direction[1]);
    else if (event.key === " ") { event.preventDefault(); play(!playing); }
  });
  byId("zoom-in").addEventListener("click", () => zoom(0.8));
  byId("zoom-out").addEventListener("click", () => zoom(1.25));
  byId("fit").addEventListener("click", fit);
  byId("play").addEventListener("click", () => play(!playing));
  byId("moment").addEventListener("input", (event) => {
    play(false);
    setMoment(Number(event.target.value));
    draw();
  });
  byId("preset").addEventListener("change", (event) => {
    const preset = settings.presets.find((each) => each.name === event.target.value);
    if (preset) choose(preset);
  });
  byId("save-png").addEventListener("click", savePng);
  byId("save-svg").addEventListener("click", () => save("svg", new Blob([svg()], { type: "image/svg+xml" })));
  byId("save-csv").addEventListener("click", () => save("csv", new Blob([csv()], { type: "text/csv" })));
  addEventListener("click", (event) => {
    if (!byId("export").contains(event.target)) byId("export").open = false;
  });
  byId("export").addEventListener("keydown", (event) => {
    if (event.key === "Escape") { byId("export").open = false; byId("export").firstElementChild.focus(); }
  });
  byId("copy-link").addEventListener("click", () => copy(`${location.origin}/?${query()}`, "Link copied"));
  byId("copy-python").addEventListener("click", () => scene && copy(scene.python, "Python copied"));
  const observer = new ResizeObserver(draw);
  observer.observe(plane);
  observer.observe(space);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { readColours(); draw(); });
}

function look(turn, lift) {
  camera.turn -= turn;
  camera.lift = Math.min(Math.max(camera.lift + lift, -1.5), 1.5);
  drawSpace();
}

// ---------------------------------------------------------------- files

// Writes what is drawn on a canvas as SVG: those methods of a canvas that this page uses.
class SvgPen {
  parts = []; path = ""; dash = "";
  beginPath() { this.path = ""; }
  moveTo(x, y) { this.path += `M${round(x)} ${round(y)}`; }
  lineTo(x, y) { this.path += `L${round(x)} ${round(y)}`; }
  rect(x, y, width, height) { this.path += `M${x} ${y}h${width}v${height}h${-width}z`; }
  arc(x, y, r) { this.path += `M${round(x - r)} ${round(y)}a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0`; }
  setLineDash(dash) { this.dash = dash.join(" "); }
  save() {}
  clip() { this.parts.push(`<clipPath id="frame"><path d="${this.path}"/></clipPath><g clip-path="url(#frame)">`); }
  restore() { this.parts.push("</g>"); }
  fill() { this.parts.push(`<path d="${this.path}" fill="${this.fillStyle}"/>`); }
  stroke() {
    this.parts.push(`<path d="${this.path}" fill="none" stroke="${this.strokeStyle}" stroke-width="${this.lineWidth}"` +
      (this.dash ? ` stroke-dasharray="${this.dash}"` : "") + "/>");
  }
  strokeText() {}
  fillText(text, x, y) {
    const anchor = { left: "start", center: "middle", right: "end" }[this.textAlign];
    this.parts.push(`<text x="${round(x)}" y="${round(y)}" text-anchor="${anchor}" fill="${this.fillStyle}" style="font: ${this.font}">${text}</text>`);
  }
}

const round = (value) => Number(value.toFixed(2));
const escaped = (text) => text.replace(/[&<>]/g, (each) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;" })[each]);

// What the picture shows: a sample of each line or dot, and its meaning.
function legend() {
  const line = (colour, width, dash = []) => (pen, x, y) => stroke(pen, [[x, y], [x + 22, y]], colour, width, dash);
  const dot = (radius, fill, edge) => (pen, x, y) => disc(pen, [x + 11, y], radius, fill, edge);
  const { levels, portrait, flow, line: steady, status } = scene;
  return [
    [dot(2.8, colours.state), "states of the map"],
    [dot(5, null, colours.accent), "first state"],
    shown.has("F") && levels.F.length && [line(colours.F, 6), "level of F"],
    shown.has("energy") && levels.energy.some(Boolean) && [line(colours.energy, 1.5, [7, 5]), "level of the energy"],
    shown.has("flow") && flow.some(Boolean) && [dot(4, null, colours.flow), "continuous motion"],
    shown.has("joined") && [line(colours.faint, 1, [1, 4]), "join of the states"],
    shown.has("portrait") && portrait && [dot(1.5, colours.faint), "other orbits, and their levels"],
    steady && [line(colours.line, 2.6, [8, 6]), "repelling steady states"],
    steady && [line(colours.line, 2.6), "attracting steady states"],
    status.failed_at !== null && [(pen, x, y) => drawCross(pen, [x + 11, y]), "last state before a pole"],
  ].filter(Boolean);
}

// The parameters, in lines that a picture of this width has room for.
function caption(width) {
  const { parameters: p, numbers } = scene, lines = [""];
  const words = Object.entries({ "I₁": p.I1, "I₂": p.I2, "I₁₃": p.I13, "I₂₃": p.I23, k: p.k, "ε": p.eps, N: p.steps,
    "Ω₁(0)": p.Omega1, "Ω₂(0)": p.Omega2, t: numbers.criticality }).map(([name, value]) => `${name} = ${short(value)}`);
  for (const word of words) {
    if (lines.at(-1).length + word.length > (width - 2 * MARGIN.left) / 6) lines.push("");
    lines[lines.length - 1] += (lines.at(-1) && ", ") + word;
  }
  return lines;
}

// The plane as a picture that stands alone: with its legend and its parameters below.
function alone(width, height) {
  const rows = legend(), columns = width > 480 ? 2 : 1, lines = caption(width), ROW = 19;
  const below = height + 10 + ROW * Math.ceil(rows.length / columns);
  return { height: below + 14 + ROW * lines.length, paint: (pen) => {
    paintPlane(pen, width, height, false);
    rows.forEach(([sample, text], k) => {
      const x = MARGIN.left + (k % columns) * width / 2, y = height + 14 + ROW * Math.floor(k / columns);
      sample(pen, x, y);
      write(pen, text, x + 30, y + 4, "left", SMALL, colours.text);
    });
    lines.forEach((text, k) => write(pen, text, MARGIN.left, below + 14 + ROW * k, "left", SMALL, colours.text));
  } };
}

function svg() {
  const { clientWidth: width, clientHeight } = byId("plane"), pen = new SvgPen();
  const { height, paint } = alone(width, clientHeight);
  paint(pen);
  return `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${width} ${height}" width="${width}" height="${height}" ` +
    `stroke-linejoin="round" stroke-linecap="round"><desc>${escaped(scene.python)}</desc>` +
    `<path d="M0 0h${width}v${height}h${-width}z" fill="${colours.panel}"/>${pen.parts.join("\n")}</svg>\n`;
}

function savePng() {
  const { clientWidth: width, clientHeight } = byId("plane"), ratio = 3;
  const { height, paint } = alone(width, clientHeight);
  const canvas = Object.assign(document.createElement("canvas"), { width: ratio * width, height: ratio * height });
  const pen = canvas.getContext("2d");
  pen.scale(ratio, ratio);
  pen.fillStyle = colours.panel;
  pen.fillRect(0, 0, width, height);
  pen.lineJoin = pen.lineCap = "round";
  paint(pen);
  canvas.toBlob((blob) => save("png", blob));
}

// Numbers in the digits that give them back exactly; states that do not exist are left out.
const csv = () => ["n,time,Omega1,Omega2", ...scene.omega.flatMap((row, n) => row ? [[n, scene.time[n], ...row].join(",")] : [])].join("\n") + "\n";

function save(kind, blob) {
  const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(blob), download: `suslov-orbit.${kind}` });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  tell(`Saved ${link.download}`);
}

async function copy(text, done) {
  try {
    await navigator.clipboard.writeText(text);
    tell(done);
  } catch {
    tell("Not allowed here: copy the address");
  }
}

function tell(text) {
  byId("export").open = false;
  byId("copied").textContent = text;
  setTimeout(() => { byId("copied").textContent = ""; }, 2500);
}

async function begin() {
  build();
  readColours();
  settings = await (await fetch("/settings")).json();
  inputs.steps.number.max = settings.longest;
  const own = new Option("Own values", "");
  byId("preset").append(...settings.presets.map(({ name }) => new Option(name, name)), own);
  document.querySelector("h1").title = `version ${settings.version}`;
  fromAddress();
  listen();
  if (!matchMedia("(prefers-reduced-motion: reduce)").matches) play(true);
}

begin().catch(() => complain(LOST));
