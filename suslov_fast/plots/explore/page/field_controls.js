// The controls of the page of a field: plane, members of a family, steps, method and start.

import { byId, short, state } from "./state.js";

const MOST_ROWS = 12; // components of the start with a field of their own, besides those of the plane
const inputs = {}, parameters = {};
let change;

// Returns the starts, as rows of texts.
export const read = () => state.values.starts.split(";").map((row) => row.split(","));

// Returns the last start in the plane.
export function components() {
  const start = read().at(-1), { names } = state.field;
  return [state.values.x, state.values.y].map((name) => Number(start[names.indexOf(name)]));
}

// Changes components of the last start.
export function setComponents(changes, typed = null) {
  const starts = read(), { names } = state.field;
  for (const [name, value] of Object.entries(changes)) {
    starts.at(-1)[names.indexOf(name)] = String(value);
    if (name in inputs && name !== typed) inputs[name].value = value;
  }
  change({ starts: starts.map((row) => row.join(",")).join(";") });
}

// Takes over the values of an answer.
export function put({ starts, member, numbers, ...values }) {
  const rows = starts.map((row) => row.join(",")).join(";");
  state.values = { ...values, starts: rows, member: member.join(","), numbers: numbers.join(",") };
}

export function build(changed) {
  change = changed;
  const { names, methods, axes, numbers, most } = state.field, { values } = state;
  for (const [id, texts] of Object.entries({ x: names, y: names, method: methods })) {
    byId(id).append(...texts.map((text) => new Option(text, text)));
    if (texts.length) byId(id).value = values[id];
    byId(id).addEventListener("change", ({ target }) => {
      change({ [id]: target.value });
      if (id !== "method") buildStart();
    });
  }
  byId("member-fields").hidden = !axes.length && !Object.keys(state.scene.values ?? {}).length;
  axes.forEach((axis, k) => member(axis, k));
  Object.entries(numbers).forEach((pair, k) => parameter(...pair, k));
  if (!axes.length && !Object.keys(numbers).length) fixed(state.scene.values);
  steps(most);
  buildStart();
}

function row(name, says, place) {
  const line = document.createElement("div");
  line.className = "field";
  const label = document.createElement("label"), slider = document.createElement("input");
  Object.assign(label, { textContent: name, title: says, htmlFor: `${name}-slider` });
  Object.assign(slider, { type: "range", id: `${name}-slider`, ariaLabel: says });
  line.append(label, slider);
  byId(place).append(line);
  return { line, slider };
}

// The members along an axis of a family have these values of the parameters.
function member({ count, parameters }, k) {
  const name = Object.keys(parameters).join(", ") || `member ${k + 1}`;
  const { line, slider } = row(name, name, "member-fields"), output = document.createElement("output");
  line.append(output);
  Object.assign(slider, { min: 0, max: count - 1, step: 1 });
  slider.value = Number(state.values.member.split(",")[k]);
  const tell = () => {
    const found = Object.values(parameters).map((values) => short(values[slider.value], 5));
    output.textContent = found.join(", ") || slider.value;
  };
  tell();
  slider.addEventListener("input", () => {
    const index = state.values.member.split(",");
    index[k] = slider.value;
    tell();
    change({ member: index.join(",") });
  });
}

// A named parameter of a single field: from 0 to twice its value, or to 1 on both sides of 0.
function parameter(name, first, k) {
  const { line, slider } = row(name, name, "member-fields"), start = state.values.numbers.split(",")[k];
  const ends = first ? [Math.min(0, 2 * first), Math.max(0, 2 * first)] : [-1, 1];
  Object.assign(slider, { min: ends[0], max: ends[1], step: (ends[1] - ends[0]) / 200, value: start });
  const input = document.createElement("input");
  Object.assign(input, { type: "number", id: `parameter-${name}`, step: "any", ariaLabel: name, value: start });
  line.append(input);
  parameters[name] = input;
  const set = (text) => {
    const found = state.values.numbers.split(",");
    found[k] = text;
    change({ numbers: found.join(",") });
  };
  slider.addEventListener("input", () => {
    input.value = Number(Number(slider.value).toPrecision(4));
    set(input.value);
  });
  input.addEventListener("input", () => {
    slider.value = input.value;
    set(input.value);
  });
}

// A field from a file has its numbers only: they are shown, and a hint on what varies them.
function fixed(values) {
  for (const [name, value] of Object.entries(values ?? {})) {
    const line = document.createElement("p");
    Object.assign(line, { className: "hint", textContent: `${name} = ${short(value)}` });
    byId("member-fields").append(line);
  }
  const hint = document.createElement("p");
  Object.assign(hint, { className: "hint", textContent: "A family, made with arrays of parameters, has a slider for each of them." });
  byId("member-fields").append(hint);
}

const inputId = (name) => (state.field.names.includes(name) ? `start-${name}` : name);

function number(id, says, place, { typed, slider }) {
  const input = document.createElement("input");
  Object.assign(input, { type: "number", id: inputId(id), step: "any", ariaLabel: says });
  place.append(input);
  inputs[id] = input;
  input.addEventListener("input", () => typed(input.value));
  if (slider) slider.ariaLabel = `${says}, slider`;
  return input;
}

// Steps of a map, or times and tolerance of a motion.
function steps(most) {
  if (!state.field.methods.length) {
    byId("method").parentElement.hidden = true;
    byId("step-fields").firstElementChild.textContent = "Motion";
    logarithmic("time", "T", "last time", [-2, 2]);
    logarithmic("rtol", "rtol", "relative tolerance", null, [-13, -2]);
    return;
  }
  logarithmic("eps", "ε", "epsilon, step size", [-3, 1]);
  const { values } = state, count = row("N", "N, number of steps", "step-fields");
  Object.assign(count.slider, { min: 1, max: most.steps, step: 1, value: values.steps });
  const countInput = number("steps", "N, number of steps", count.line, {
    slider: count.slider,
    typed: (text) => {
      count.slider.value = text;
      change({ steps: text });
    },
  });
  countInput.value = values.steps;
  count.slider.addEventListener("input", () => {
    countInput.value = count.slider.value;
    change({ steps: count.slider.value });
  });
}

// A number with a slider of powers of ten, about its first value or between fixed ends.
function logarithmic(id, label, says, about, fixedEnds) {
  const { values } = state, { line, slider } = row(label, says, "step-fields");
  const first = Number(values[id]) || 0.01, sign = Math.sign(first), middle = Math.log10(Math.abs(first));
  const [min, max] = fixedEnds ?? about.map((end) => middle + end);
  Object.assign(slider, { min, max, step: 0.01, value: middle });
  const input = number(id, says, line, {
    slider,
    typed: (text) => {
      if (Number(text)) slider.value = Math.log10(Math.abs(Number(text)));
      change({ [id]: text });
    },
  });
  input.value = values[id];
  slider.addEventListener("input", () => {
    input.value = Number((sign * 10 ** slider.value).toPrecision(3));
    change({ [id]: input.value });
  });
}

// Fields for the components of the last start: all, or those of the plane and the first ones.
function buildStart() {
  const { names } = state.field, { x, y } = state.values, start = read().at(-1);
  const place = byId("start-fields");
  for (const line of place.querySelectorAll(".choice")) line.remove();
  for (const [k, name] of names.entries()) {
    if (k >= MOST_ROWS && name !== x && name !== y) continue;
    const line = document.createElement("label");
    Object.assign(line, { className: "choice", textContent: name });
    place.append(line);
    number(name, `${name} at the start`, line, {
      typed: (text) => setComponents({ [name]: text }, name),
    }).value = start[k];
  }
}

// Marks the fields that an error message names.
export function mark(fields) {
  for (const [name, input] of [...Object.entries(inputs), ...Object.entries(parameters)]) {
    input.parentElement.classList.toggle("wrong", fields.includes(name));
    input.toggleAttribute("aria-invalid", fields.includes(name));
  }
}
