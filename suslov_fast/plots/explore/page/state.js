// The state that the modules of the page share, and how numbers are written.

export const state = {
  scene: null, // the numbers of the last answer
  values: {}, // texts of the fields, because a wrong value stays as the user wrote it
  extent: 4, // the plane reaches from -extent to extent; 0 on the page of a field
  shown: new Set(["F", "energy"]),
  moment: 0, // index of the current state of the body in space
  share: 0, // part of the way from this state to the next
};

export const byId = (id) => document.getElementById(id);

// Returns the index of the last state that exists.
export function last() {
  const missing = state.scene.omega.indexOf(null);
  return missing < 0 ? state.scene.omega.length - 1 : Math.max(missing - 1, 0);
}

export function short(value, digits = 6) {
  if (value === null) return "none";
  return Number(value.toPrecision(digits)).toString().replaceAll("-", "−");
}

// Returns the query of the address: the values of all fields, and the view.
export function query() {
  const { values, extent, shown } = state;
  const view = extent && { extent: Number(extent.toPrecision(6)), show: [...shown].join(" ") };
  return new URLSearchParams({ ...values, ...view }).toString();
}

let remembering = null;

// Stores the query in the address of the page.
export function remember() {
  // Delayed, because browsers forbid a page to change its address at every move of the mouse.
  clearTimeout(remembering);
  remembering = setTimeout(() => history.replaceState(null, "", `?${query()}`), 150);
}
