// The description of an orbit in words, and the table of numbers.

import { byId, short, state } from "./state.js";

const REGIMES = {
  unknown: "The criticality of these numbers is beyond the range of float64.",
  still: "With a step size of 0 nothing moves: every state is its own next state.",
  steady: "This state is a steady rotation: a fixed point of the map.",
  below:
    "The orbit follows the continuous motion on a level curve of F, from the repelling half of " +
    "the line of steady states to the attracting one.",
  ahead:
    "The orbit leads from the repelling half of the line of steady states to the attracting one, " +
    "as the continuous motion does, but faster: near the end a step takes it {ahead} times as far, " +
    "and it is on a level curve of F, not of the energy.",
  at: "The orbit reaches a steady state in one or two steps.",
  above:
    "The step is too long to follow the continuous motion: the orbit jumps across the line of " +
    "steady states, and tends to it.",
  pole:
    "The step is too long to follow the continuous motion: the orbit jumps across the line of " +
    "steady states, and meets a pole of the map.",
  rotor:
    "The momentum of the rotor exceeds that of the products of inertia: the orbit never comes to " +
    "rest, and turns on a level curve of F.",
};
const TITLES = { steady: "Steady rotation", still: "No motion: ε = 0", unknown: "Beyond float64" };

export function describe() {
  const { numbers, regime, status, ellipsoid } = state.scene;
  const t = numbers.criticality;
  byId("regime-name").textContent = TITLES[regime] ?? compared(t);
  byId("regime-text").textContent = REGIMES[regime].replace("{ahead}", short(numbers.ahead, 4));
  byId("gauge").value = t === null ? 2 : Math.abs(t);
  byId("gauge").textContent = short(t);
  const badge = byId("status"), { name, message, failed_at } = status;
  badge.textContent = badge.dataset.status = name;
  badge.title = message;
  byId("failure").textContent = missing(status);
  byId("numbers").replaceChildren(...rows(numbers).flat());
  byId("matter").textContent = ellipsoid ? aboutEllipsoid(ellipsoid) : "";
}

// Returns why a state does not exist, or nothing where all do.
export function missing({ name, failed_at }) {
  if (failed_at === null) return "";
  const why = name === "SINGULAR" ? `state ${failed_at - 1} lies on a pole of the map` :
    "it is beyond the range of float64";
  return `State ${failed_at} does not exist: ${why}.`;
}

function compared(t) {
  const size = Math.abs(t), sign = size === 1 ? "" : size < 1 ? " < 1" : " > 1";
  return `${t < 0 ? "|criticality|" : "Criticality"} ${short(size, 5)}${sign}`;
}

const aboutEllipsoid = ({ I3, matter }) =>
  `Ellipsoid of inertia with I₃ = ${short(I3, 4)}` +
  (matter ? "." : ". No rigid body has these parameters.");

const pair = (vector) => (vector ? `(${vector.map((each) => short(each, 5)).join(", ")})` : "none");

function rows(numbers) {
  const { drift, scattering_angle: angle, I3 } = numbers;
  const texts = {
    criticality: short(numbers.criticality),
    F: short(numbers.F),
    "largest change of F": drift ? drift.toExponential(1).replace("-", "−") : short(drift),
    energy: short(numbers.energy),
    "limit n → −∞": pair(numbers.omega_minus),
    "limit n → +∞": pair(numbers.omega_plus),
    "scattering angle": angle === null ? "none" : `${short((angle * 180) / Math.PI, 5)}°`,
    "I₃ of a rigid body": I3 ? I3.map((each) => short(each, 4)).join(" to ") : "none",
  };
  return Object.entries(texts).map((pair) => pair.map((text, k) => {
    const cell = document.createElement(k ? "dd" : "dt");
    cell.textContent = text;
    return cell;
  }));
}
