import assert from "node:assert/strict";
import { test } from "node:test";
import { hear, order } from "../src/command.js";

test("a command says of which run of the rig it is, and up to when in the rig's own time", () => {
  assert.equal(order("a", "", 0).headers["X-Trocar-Before"], undefined); // no rig was heard: it is refused
  hear({ incarnation: 7, t: 100.25 }, 5000);
  assert.deepEqual(order("a", "b", 5400).headers, { "X-Trocar-Token": "a", "X-Trocar-Before": "7 103.650" });
});
