import assert from "node:assert/strict";
import { test } from "node:test";

import { Walk } from "../src/settings/felt.js";
import { boundsOf, bytes, shown, yamlOf } from "../src/settings/values.js";

test("what is typed becomes the YAML of what was meant", () => {
  const text = { kind: "string" }, number = { kind: "number" };
  assert.equal(yamlOf("touch", text), "touch");
  assert.equal(yamlOf("yes", text), '"yes"');
  assert.equal(yamlOf("a: b # c", text), '"a: b # c"');
  assert.equal(yamlOf("", text), '""');
  assert.equal(yamlOf("", { kind: "string", optional: true }), "null");
  assert.equal(yamlOf("1.0e-3", number), "1.0e-3");
  assert.equal(yamlOf("", { kind: "number", optional: true }), "null");
  assert.equal(yamlOf("2", { kind: "choice", choices: [1, 2] }), "2");
  assert.equal(yamlOf("null", { kind: "choice", choices: ["null"] }), '"null"');
  assert.equal(yamlOf("[1, 2]", { kind: "yaml" }), "[1, 2]");
});

test("values, bounds and sizes are read as people read them", () => {
  assert.deepEqual([shown(null, "number"), shown(0.001, "number"), shown("ipc", "choice"), shown([1, 2], "yaml")], ["", "0.001", "ipc", "[1,2]"]);
  assert.equal(boundsOf({ above: 0, most: 2 }), "> 0, ≤ 2");
  assert.equal(boundsOf({}), "");
  assert.deepEqual([0, 999, 1500, 2.5e9].map(bytes), ["0 B", "999 B", "1.5 kB", "2.5 GB"]);
});

const AT_REST = { calibrated: true, state: "running", stopped: false, newton: 0, place: [0, 0, 0] };
// Shows an arm's walk what is there now, and returns how many steps are done.
const seeing = (walk) => (now) => {
  walk.see({ ...AT_REST, ...now });
  return walk.done;
};

test("an arm's felt test begins at its own calibration, and its encoders must move on every axis", () => {
  const walk = new Walk("left"), see = seeing(walk);
  assert.equal(see({ calibrated: false }), 0, "the rig runs, and the arm is not calibrated");
  assert.equal(see({}), 1);
  see({});
  see({ place: [25, 25, 0] });
  assert.equal(walk.asks, false, "one axis has not moved");
  see({ place: null });
  see({ place: [0, 0, -21] });
  assert.equal(walk.asks, true);
  assert.equal(walk.done, 1, "not before the person has said so");
  walk.answer(true);
  assert.equal(walk.done, 2);
});

const ready = () => {
  const walk = new Walk("left"), see = seeing(walk);
  see({});
  see({});
  see({ place: [25, 25, 25] });
  walk.answer(true);
  return { walk, see };
};

test("force and limpness count only once the person has felt them", () => {
  const { walk, see } = ready();
  assert.equal(see({ stopped: true }), 2, "not armed");
  assert.equal(see({}), 3);
  see({ newton: 0.19 });
  assert.equal(walk.asks, false);
  see({ newton: 0.2 });
  assert.equal(see({ newton: 0 }), 3, "drawing back answers nothing");
  walk.answer(true);
  assert.equal(see({ newton: 0.06 }), 4);
  assert.equal(see({ newton: 0.04 }), 5);
  see({ stopped: true, state: "safe_stop" });
  assert.equal(walk.asks, false, "it has not pressed before the stop");
  see({ newton: 0.3 });
  see({ stopped: true, state: "safe_stop" });
  assert.equal(walk.asks, true);
  assert.equal(walk.result, null);
  walk.answer(true);
  assert.deepEqual(walk.result, { passed: true, step: "" });
});

test("a no ends the test of this arm at its step", () => {
  const { walk, see } = ready();
  see({});
  see({ newton: 0.3 });
  walk.answer(false);
  assert.deepEqual(walk.result, { passed: false, step: "force" });
  assert.equal(see({ newton: 0 }), 3, "it goes no further");
  walk.answer(true);
  assert.deepEqual(walk.result, { passed: false, step: "force" });
});
