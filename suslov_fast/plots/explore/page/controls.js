// Fields, sliders and presets: each change asks Python for new numbers.

import { PRESETS } from "./presets.js";
import { byId, remember, state } from "./state.js";

export const FIELDS = {
  I1: { html: "I<sub>1</sub>", min: 0.05, max: 10, step: 0.05, says: "I1, moment of inertia" },
  I2: { html: "I<sub>2</sub>", min: 0.05, max: 10, step: 0.05, says: "I2, moment of inertia" },
  I13: { html: "I<sub>13</sub>", min: -3, max: 3, step: 0.05, says: "I13, product of inertia" },
  I23: { html: "I<sub>23</sub>", min: -3, max: 3, step: 0.05, says: "I23, product of inertia" },
  k: { html: "k", min: -3, max: 3, step: 0.05, says: "k, momentum of a rotor along the constrained axis" },
  eps: { html: "ε", min: -2, max: 2, step: 0.01, says: "epsilon, step size" },
  steps: { html: "N", min: 1, max: 2000, step: 1, says: "N, number of steps" },
  Omega1: { html: "Ω<sub>1</sub>", min: -4, max: 4, step: 0.01, says: "Omega1 at the start" },
  Omega2: { html: "Ω<sub>2</sub>", min: -4, max: 4, step: 0.01, says: "Omega2 at the start" },
};
const inputs = {};
// `ask` gets new numbers, `draw` draws the current ones.
let ask, draw;

export function build(actions) {
  ({ ask, draw } = actions);
  for (const set of document.querySelectorAll("fieldset[data-fields]"))
    for (const name of set.dataset.fields.split(" ")) set.append(field(name));
  for (const box of document.querySelectorAll("#show input"))
    box.addEventListener("change", () => show(box.value, box.checked));
  byId("controls").addEventListener("submit", (event) => event.preventDefault());
  const options = Object.keys(PRESETS).map((name) => new Option(name, name));
  byId("preset").append(...options, new Option("Own values", ""));
  byId("preset").addEventListener("change", ({ target }) => {
    if (target.value) choose(PRESETS[target.value]);
  });
}

function field(name) {
  const { html, min, max, step, says } = FIELDS[name];
  const row = document.createElement("div");
  row.className = "field";
  row.innerHTML =
    `<label for="${name}" title="${says}">${html}</label>` +
    `<input type="range" id="${name}-slider" aria-label="${says}, slider"` +
    ` min="${min}" max="${max}" step="${step}">` +
    `<input type="number" id="${name}" aria-label="${says}" step="${step}">`;
  const [slider, number] = row.querySelectorAll("input");
  inputs[name] = { slider, number };
  slider.addEventListener("input", () => change({ [name]: slider.value }));
  number.addEventListener("input", () => change({ [name]: number.value }, name));
  return row;
}

function show(name, on) {
  if (on) state.shown.add(name);
  else state.shown.delete(name);
  remember();
  if (name === "portrait") ask();
  draw();
}

// Sets values of some fields; the text of the field that the user types in stays as it is.
export function change(changes, typed = null) {
  for (const [name, value] of Object.entries(changes)) put(name, String(value), name !== typed);
  selectPreset();
  remember();
  ask();
}

function put(name, value, written = true) {
  state.values[name] = value;
  if (!(name in inputs)) return; // an unknown parameter of an address: Python answers with an error
  inputs[name].slider.value = value;
  if (written) inputs[name].number.value = value;
}

// Selects the preset that has these values, if there is one.
function selectPreset() {
  const same = ([, preset]) =>
    Object.keys(FIELDS).every((field) => Number(state.values[field]) === preset[field]);
  byId("preset").value = Object.entries(PRESETS).find(same)?.[0] ?? "";
}

// Sets all values at once, from a preset or an address.
function choose({ extent, ...parameters }) {
  state.values = {};
  for (const [name, value] of Object.entries(parameters)) put(name, String(value));
  selectPreset();
  state.moment = 0;
  setExtent(extent, false);
  ask();
}

// Sets the extent of the plane, and of the sliders for the first state.
export function setExtent(value, anew = true) {
  state.extent = Math.min(Math.max(value, 1e-12), 1e12);
  const step = 10 ** Math.floor(Math.log10(state.extent / 200));
  for (const name of ["Omega1", "Omega2"]) {
    const { slider, number } = inputs[name];
    Object.assign(slider, { min: -state.extent, max: state.extent, step: "any" });
    slider.value = state.values[name];
    number.step = step;
  }
  remember();
  if (anew && state.shown.has("portrait") && state.scene) ask();
  draw();
}

// Returns the shortest text of a number, and any other text unchanged.
const tidy = (text) => (text && Number.isFinite(Number(text)) ? String(Number(text)) : text);

export function fromQuery(text) {
  const given = new URLSearchParams(text), [first] = Object.values(PRESETS);
  if (given.has("show")) state.shown = new Set(given.get("show").split(" ").filter(Boolean));
  for (const box of document.querySelectorAll("#show input"))
    box.checked = state.shown.has(box.value);
  const extent = Number(given.get("extent")) || first.extent;
  for (const name of ["show", "extent"]) given.delete(name);
  const found = [...given].map(([name, value]) => [name, tidy(value)]);
  // Where parameters are missing, Python answers with an error.
  choose({ ...(found.length ? { k: 0, ...Object.fromEntries(found) } : first), extent });
}

// Marks the fields that an error message names.
export function mark(fields) {
  for (const [name, { number }] of Object.entries(inputs)) {
    number.parentElement.classList.toggle("wrong", fields.includes(name));
    number.toggleAttribute("aria-invalid", fields.includes(name));
  }
}
