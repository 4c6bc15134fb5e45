// Presets: bodies and first states. With I1 = I2 = 1, I13 = 0.25 and I23 = 0, the criticality is
// computed without rounding. All are rigid bodies, except where the name says otherwise.

const NAMES = ["I1", "I2", "I13", "I23", "k", "eps", "Omega1", "Omega2", "steps", "extent"];
const VALUES = {
  "A rigid body": [4, 2, -0.5, -0.3, 0, 0.2, -0.9, 1.3, 300, 4],
  "Long steps: criticality 0.5": [3, 3, -0.2, -0.2, 0, 1, -8, 7, 40, 14],
  "Criticality 1": [1, 1, 0.25, 0, 0, 1, 2, -8, 5, 14],
  "Criticality above 1: jumps": [1, 1, 0.25, 0, 0, 1, 2, -16, 60, 30],
  "A pole: no next state": [1, 1, 0.25, 0, 0, 1, 2, -9, 20, 14],
  "A rotor: periodic": [4, 2, -0.5, -0.3, 1, 0.2, 1.2, 0.6, 300, 4],
  "Paper, figure 1 (no rigid body)": [4, 1, -0.5, -0.3, 0, 0.2, -0.8, 1.3, 300, 4],
  "Paper, figure 2": [4, 3, -0.4, -0.2, 0, 0.2, -2.5, 5.5, 300, 10],
  "Paper, figure 3": [4, 2, 0, -0.2, 0, 0.02, -60, 3, 300, 100],
  "Paper, figure 4": [3, 3, -0.2, -0.2, 0, 1, -1.5, 1.4, 100, 3]
};

const named = (values) => Object.fromEntries(NAMES.map((name, k) => [name, values[k]]));
export const PRESETS = Object.fromEntries(
  Object.entries(VALUES).map(([name, values]) => [name, named(values)]),
);
