// The page: asks Python for numbers, draws them, and listens to the user. It computes no dynamics.

import { asking, say } from "./asking.js";
import { build, change, fromQuery, mark, setExtent } from "./controls.js";
import { buildExport } from "./export.js";
import { alone, csv } from "./figure.js";
import { readColours } from "./pen.js";
import { drawPlane, reach, view } from "./plane.js";
import { buildPlayer, play, setMoment } from "./player.js";
import { drawSpace, look } from "./space.js";
import { byId, last, state } from "./state.js";
import { describe } from "./words.js";

function begin() {
  readColours();
  build({ ask: asking(receive, complain), draw });
  buildPlayer(draw);
  buildExport({ alone, csv });
  fromQuery(location.search);
  listen();
  if (!matchMedia("(prefers-reduced-motion: reduce)").matches) play(true);
}

function receive(found) {
  state.scene = found;
  say("");
  mark([]);
  document.body.classList.remove("stale");
  byId("moment").max = last();
  setMoment(Math.min(state.moment, last()));
  document.querySelector("h1").title = `version ${found.version}`;
  describe();
  draw();
}

function complain(message, fields = []) {
  say(message);
  mark(fields);
  document.body.classList.add("stale");
  // These texts describe other values.
  for (const id of ["status", "regime-text", "failure"]) byId(id).textContent = "";
  byId("regime-name").textContent = "No orbit";
}

function draw() {
  drawPlane();
  drawSpace();
}

const zoom = (factor) => setExtent(state.extent * factor);

function fit() {
  const extent = state.scene && reach();
  if (extent) setExtent(extent);
}

// Moves the first state to a pixel, with as many digits as the pixel resolves.
function moveStart(px, py) {
  const { scale, from } = view(), digits = Math.ceil(Math.log10(scale)) + 1;
  const places = Math.min(Math.max(digits, 0), 20);
  const [Omega1, Omega2] = from(px, py).map((each) => Number(each.toFixed(places)));
  change({ Omega1, Omega2 });
}

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

function arrows(event) {
  if (event.key in ARROWS) event.preventDefault();
  return ARROWS[event.key];
}

function listen() {
  listenToPlane(byId("plane"));
  listenToSpace(byId("space"));
  byId("zoom-in").addEventListener("click", () => zoom(0.8));
  byId("zoom-out").addEventListener("click", () => zoom(1.25));
  byId("fit").addEventListener("click", fit);
  const observer = new ResizeObserver(draw);
  observer.observe(byId("plane"));
  observer.observe(byId("space"));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    readColours();
    draw();
  });
}

function listenToPlane(plane) {
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
      const { Omega1, Omega2 } = state.values, pixels = event.shiftKey ? 20 : 2;
      const [x, y] = view().at([Number(Omega1), Number(Omega2)]);
      moveStart(x + pixels * direction[0], y - pixels * direction[1]);
    } else if (event.key === "+" || event.key === "=") zoom(0.8);
    else if (event.key === "-") zoom(1.25);
    else if (event.key === "0") fit();
  });
}

function listenToSpace(space) {
  space.addEventListener("pointerdown", (event) => space.setPointerCapture(event.pointerId));
  space.addEventListener("pointermove", (event) => {
    if (space.hasPointerCapture(event.pointerId)) look(0.01 * event.movementX, 0.01 * event.movementY);
  });
  space.addEventListener("keydown", (event) => {
    const direction = arrows(event);
    if (direction) look(0.1 * direction[0], -0.1 * direction[1]);
  });
}

begin();
