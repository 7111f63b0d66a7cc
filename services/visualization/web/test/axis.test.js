import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";
import { Axis } from "../src/hands/axis.js";
import { Gamepads } from "../src/hands/gamepad.js";

// The same table holds services/gateway/hands/input_axis.py: tests/gateway/hands/test_input_axis.py.
const cases = JSON.parse(readFileSync(new URL("axis.json", import.meta.url)));

for (const { case: name, low, high, first, looks } of cases) {
  test(name, () => {
    const axis = new Axis(low, high, first);
    for (const [now, raw, stick, trigger] of looks) {
      if (raw !== null) axis.report(raw, now);
      axis.advance(now);
      assert.ok(Math.abs(axis.stick() - stick) < 1e-6, `stick at ${now} ms: ${axis.stick()}, not ${stick}`);
      assert.ok(Math.abs(axis.trigger() - trigger) < 1e-6, `trigger at ${now} ms: ${axis.trigger()}, not ${trigger}`);
    }
  });
}

// A repeatable random number of 0 to 1.
function dice(seed) {
  return () => {
    seed = (seed + 0x6d2b79f5) | 0;
    let t = Math.imul(seed ^ (seed >>> 15), 1 | seed);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
  };
}

const buttons = () => Array.from({ length: 17 }, () => ({ value: 0 }));
const moves = (hands) => Math.max(...hands.flatMap(({ by, roll, closing }) => [...by, roll, closing]).map(Math.abs));

test("whatever pad nobody touches moves nothing: 300 made up", () => {
  for (let seed = 1; seed <= 300; seed++) {
    const roll = dice(seed), gamepads = new Gamepads();
    const late = roll() < 0.5 ? 0 : 900 * roll(); // until its first report a browser says 0
    const rest = [0, 1, 2, 3].map(() => (late === 0 && roll() < 0.3 ? 2 * roll() - 1 : 0.3 * (roll() - 0.5)));
    const noise = roll() < 0.5 ? 0 : 0.03 * roll(), drift = 0.03 * (roll() - 0.5);
    const held = buttons().map(() => ({ value: roll() < 0.1 ? 1 : 0 })), trigger = roll() < 0.3 ? roll() : 0;
    held[6] = { value: trigger };
    for (let now = 0; now < 3000; now += 16) {
      const axes = rest.map((x) => (now < late ? 0 : x + noise * (roll() - 0.5) + drift * (now / 1000)));
      const pad = { connected: true, mapping: "standard", id: "made up", index: 0, axes, buttons: held };
      assert.equal(moves(gamepads.read(0.016, now, [pad])), 0, `seed ${seed} at ${now} ms: ${axes}`);
    }
  }
});

test("the page says which pad it does not use, and why", () => {
  const gamepads = new Gamepads();
  const pad = (id, index, mapping) => ({ connected: true, id, index, mapping, axes: [0, 0.6, 0, 0], buttons: buttons() });
  const pads = [pad("Old", 0, ""), pad("First", 1, "standard"), pad("Second", 2, "standard")];
  for (let now = 0; now <= 2100; now += 16) gamepads.read(0.016, now, pads);
  assert.match(gamepads.ignored.join(" "), /“Old” is not used: this browser does not know its layout/);
  assert.match(gamepads.ignored.join(" "), /“Second” is not used: one pad moves both hands, and “First” does/);
  assert.match(gamepads.ignored.join(" "), /“First” is not used in part: left stick, up and down rests at 80 % of its way/);
});
