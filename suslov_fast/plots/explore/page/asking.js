// Requests for new numbers while the user changes values, and the message at the foot of the page.

import { byId, query } from "./state.js";

const GONE = "suslov-fast does not answer: start it again and reload this page.";

async function fetchScene() {
  try {
    return await (await fetch(`/scene?${query()}`)).json();
  } catch {
    throw new Error(GONE);
  }
}

// Returns the function that asks for new numbers; of calls during a request only the last counts.
export function asking(receive, complain) {
  let busy = false, again = false;
  return async function ask() {
    again = busy;
    if (busy) return;
    busy = true;
    document.documentElement.dataset.busy = "";
    const begun = Date.now();
    const clock = setInterval(() => {
      const seconds = Math.round((Date.now() - begun) / 1000);
      say(`Compiling the kernels, once per installation. ${seconds} s`, true);
    }, 1000);
    try {
      const found = await fetchScene();
      if (found.error) complain(found.error, found.fields);
      else receive(found);
    } catch (error) {
      complain(error.message);
    }
    clearInterval(clock);
    busy = false;
    if (again) ask();
    else delete document.documentElement.dataset.busy;
  };
}

export function say(message, waiting = false) {
  const place = byId("message");
  place.textContent = message;
  place.hidden = !message;
  place.classList.toggle("waiting", waiting);
}
