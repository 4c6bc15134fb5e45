// The page of a field: asks Python for orbits, draws them in a plane of two components.

import { asking, say } from "./asking.js";
import { buildExport } from "./export.js";
import { build, components, mark, put, read, setComponents } from "./field_controls.js";
import { alone, at, csv, drawOrbits, fitted, view } from "./field_plane.js";
import { readColours } from "./pen.js";
import { byId, remember, short, state } from "./state.js";
import { missing } from "./words.js";

const ask = asking(receive, complain);

async function begin() {
  state.extent = 0;
  readColours();
  state.values = Object.fromEntries(new URLSearchParams(location.search));
  buildExport({ alone, csv });
  listen();
  await ask();
}

function receive(found) {
  const isFirst = !state.field;
  state.scene = found;
  say("");
  if (isFirst) first(found);
  else mark([]);
  document.body.classList.remove("stale");
  document.querySelector("h1").title = `version ${found.version}`;
  if (!state.values.box) setBox(fitted());
  describe();
  drawOrbits();
}

// Builds the controls for a field, once its names are known.
function first({ field, parameters }) {
  state.field = field;
  if (parameters) put(parameters);
  build(change);
}

function complain(message, fields = []) {
  say(message);
  document.body.classList.add("stale");
  if (state.field) mark(fields);
  else if (fields.length) { // a wrong address: begin with the first view, and say what was wrong
    state.values = {};
    ask().then(() => say(message));
  }
  for (const id of ["status", "regime-text", "failure", "others"]) byId(id).textContent = "";
  byId("regime-name").textContent = "No orbit";
}

// Changes some values, and asks for their orbits; another plane is shown as a whole.
function change(changes) {
  if ("x" in changes || "y" in changes) changes.box = "";
  Object.assign(state.values, changes);
  remember();
  ask();
}

function setBox(box) {
  state.values.box = box.map((end) => Number(end.toPrecision(6))).join(",");
  remember();
  drawOrbits();
}

// Changes the lengths of both axes by a factor, about a pixel or the middle.
function zoom(factor, px = null, py = null) {
  if (!state.scene) return;
  const { box, from, x0, x1, y0, y1 } = view();
  const [u, v] = from(px ?? (x0 + x1) / 2, py ?? (y0 + y1) / 2), centre = [u, u, v, v];
  const ends = box.map((end, k) => centre[k] + factor * (end - centre[k]));
  if (ends.every(Number.isFinite) && ends[1] > ends[0] && ends[3] > ends[2]) setBox(ends);
}

// Moves the last start to a pixel, with as many digits as the pixel resolves.
function moveStart(px, py) {
  const { from, x0, x1, y0, y1, box } = view(), [u, v] = from(px, py);
  const rounded = (value, size) => {
    const places = Math.min(Math.max(1 - Math.floor(Math.log10(size)), 0), 20);
    return Number(value.toFixed(places));
  };
  const near = [rounded(u, (box[1] - box[0]) / (x1 - x0)), rounded(v, (box[3] - box[2]) / (y1 - y0))];
  setComponents({ [state.values.x]: near[0], [state.values.y]: near[1] });
}

function describe() {
  const { orbits, time } = state.scene, orbit = orbits.at(-1);
  const { status: name, failed_at, first_pole: pole, end } = orbit, isMotion = end !== undefined;
  const badge = byId("status");
  badge.textContent = badge.dataset.status = name;
  badge.title = orbit.message;
  const what = pole >= 0 ? "Passed a pole" : failed_at === null ? "All states exist" : "Ends at a pole";
  byId("regime-name").textContent = isMotion ? (failed_at === null ? what : "The solution stops") :
    name === "NONFINITE" && pole < 0 ? "Beyond float64" : what;
  byId("regime-text").textContent = pole < 0 ? "" :
    `Before state ${pole}, time ${short(time[pole])}: the motion escapes to infinity, or ε ` +
    "is too large. States from there on belong to the map, not to the motion.";
  byId("failure").textContent = !isMotion ? missing({ name, failed_at }) :
    failed_at === null ? "" : `At time ${short(end)}: ${orbit.message}.`;
  const bad = orbits.filter((each) => each.first_pole >= 0).length;
  const ended = orbits.filter((each) => each.failed_at !== null).length;
  byId("others").textContent = orbits.length === 1 ? "" :
    `Of ${orbits.length} orbits ${bad} passed a pole, ${ended} ended.`;
  const rows = { time: short(time.at(-1)) };
  state.field.names.forEach((each, k) => {
    if (k < 8) rows[`last ${each}`] = orbit.final ? short(orbit.final[k]) : "none";
  });
  if ("energy" in orbit)
    Object.assign(rows, { energy: short(orbit.energy), "range of the energy": short(orbit.change, 2) });
  byId("numbers").replaceChildren(...Object.entries(rows).flatMap((pair) => pair.map((text, k) => {
    const cell = document.createElement(k ? "dd" : "dt");
    cell.textContent = text;
    return cell;
  })));
  byId("equations").textContent = state.scene.equations;
}

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

function listen() {
  const plane = byId("plane");
  byId("controls").addEventListener("submit", (event) => event.preventDefault());
  byId("zoom-in").addEventListener("click", () => zoom(0.8));
  byId("zoom-out").addEventListener("click", () => zoom(1.25));
  byId("fit").addEventListener("click", () => state.scene && setBox(fitted()));
  for (const id of ["joined", "dots"]) byId(id).addEventListener("change", drawOrbits);
  byId("clear").addEventListener("click", () => change({ starts: read().at(-1).join(",") }));
  new ResizeObserver(drawOrbits).observe(plane);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    readColours();
    drawOrbits();
  });
  plane.addEventListener("pointerdown", (event) => {
    if (!state.scene) return;
    plane.setPointerCapture(event.pointerId);
    const starts = read(), { most } = state.field;
    if (byId("keep").checked && starts.length < most.starts)
      state.values.starts = [...starts, starts.at(-1)].map((row) => row.join(",")).join(";");
    moveStart(event.offsetX, event.offsetY);
  });
  plane.addEventListener("pointermove", (event) => {
    if (plane.hasPointerCapture(event.pointerId)) moveStart(event.offsetX, event.offsetY);
  });
  plane.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(Math.exp(event.deltaY * 0.0012), event.offsetX, event.offsetY);
  }, { passive: false });
  plane.addEventListener("keydown", (event) => {
    const direction = ARROWS[event.key];
    if (direction && state.scene) {
      event.preventDefault();
      const pixels = event.shiftKey ? 20 : 2, [x, y] = at(components());
      moveStart(x + pixels * direction[0], y - pixels * direction[1]);
    } else if (event.key === "+" || event.key === "=") zoom(0.8);
    else if (event.key === "-") zoom(1.25);
    else if (event.key === "0" && state.scene) setBox(fitted());
  });
}

begin();
