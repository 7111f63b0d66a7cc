import assert from "node:assert/strict";
import { test } from "node:test";

import { stepsFor, Walk } from "../src/settings/devices.js";
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

test("each step of the felt test counts from when the one before was seen", () => {
  const walk = new Walk(stepsFor([{ name: "left" }, { name: "right" }]));
  const see = (state, stopped, forces) => {
    walk.see({ state, stopped, forces });
    return walk.done;
  };
  assert.equal(see("starting", false, [0.3, 0.3]), 0);
  assert.equal(see("running", true, [0.3, 0.3]), 1);
  assert.equal(see("running", true, [0.3, 0.3]), 1, "not armed");
  assert.equal(see("running", false, [0.3, 0]), 2);
  assert.equal(see("running", false, [0.3, 0]), 3, "left has pressed");
  assert.equal(see("running", false, [0.3, 0.1]), 3);
  assert.equal(see("running", false, [0, 0.2]), 4);
  assert.equal(see("running", false, [0, 0.06]), 4);
  assert.equal(see("running", false, [0, 0]), 5);
  assert.equal(see("safe_stop", true, [0, 0]), 6);
  assert.equal(see("running", false, [0, 0]), 7);
  assert.equal(walk.steps.length, 7);
});
