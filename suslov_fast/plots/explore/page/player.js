// The player: the current state of the body in space, and its motion.

import { byId, last, state } from "./state.js";

let playing = false, before = null, resting = 0, draw;

export function setMoment(n) {
  state.moment = n;
  state.share = 0;
  byId("moment").value = n;
  byId("moment-value").value = `n = ${n}`;
}

export function play(on) {
  playing = on;
  byId("play").textContent = on ? "Pause" : "Play";
  byId("play").setAttribute("aria-pressed", String(on));
  if (!on) return;
  if (state.scene && state.moment >= last()) setMoment(0);
  before = null;
  requestAnimationFrame(tick);
}

function tick(now) {
  if (!playing) return;
  if (before !== null && state.scene) {
    advance(Math.min(now - before, 200) / 1000);
    draw();
  }
  before = now;
  requestAnimationFrame(tick);
}

function advance(seconds) {
  if (state.moment >= last()) {
    resting += seconds;
    if (resting > 1) setMoment(0); // after a second at the end, start again
    return;
  }
  resting = 0;
  const speed = Number(byId("speed").value);
  const reached = Math.min(state.moment + state.share + seconds * speed, last());
  const whole = Math.floor(reached);
  if (whole !== state.moment) setMoment(whole);
  state.share = reached - whole;
}

export function buildPlayer(drawing) {
  draw = drawing;
  byId("play").addEventListener("click", () => play(!playing));
  byId("moment").addEventListener("input", ({ target }) => {
    play(false);
    setMoment(Number(target.value));
    draw();
  });
  byId("space").addEventListener("keydown", (event) => {
    if (event.key !== " ") return;
    event.preventDefault();
    play(!playing);
  });
}
