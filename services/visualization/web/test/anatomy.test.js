import assert from "node:assert/strict";
import { test } from "node:test";

import { nearestEnd, onLine, Picks } from "../src/anatomy/picks.js";

const duct = () => ({
  ends: [
    { name: "a", at_mm: [0, 0, 0], width_mm: 6 },
    { name: "b", at_mm: [40, 0, 0], width_mm: 4 },
    { name: "c", at_mm: [20, 30, 0], width_mm: 4 },
  ],
  mouth: "c",
  held: ["a", "b"],
  ports_mm: [[1, 2, 3], [4, 5, 6]],
  goal_mm: null,
});

test("an end that becomes the mouth is no longer held, and the old mouth is", () => {
  const picks = new Picks(duct());
  picks.setMouth("a");
  assert.deepEqual([picks.mouth, [...picks.held].sort()], ["a", ["b", "c"]]);
  picks.toggleHeld("b");
  picks.toggleHeld("a");
  assert.deepEqual([picks.kind("a"), picks.kind("b"), picks.kind("c")], ["mouth", "free", "held"]);
});

test("ports are sent when they were moved, and proposed otherwise", () => {
  const picks = new Picks(duct());
  assert.deepEqual(picks.body().ports_mm, []);
  picks.setPort(1, [7, 8, 9]);
  assert.deepEqual(picks.body().ports_mm, [[1, 2, 3], [7, 8, 9]]);
  picks.proposePorts();
  assert.deepEqual(picks.body().ports_mm, []);
});

test("what cannot be saved is said", () => {
  const picks = new Picks(duct());
  picks.ends[0].newName = "b";
  assert.match(picks.fault(), /same name/);
  picks.ends[0].newName = "two words";
  assert.match(picks.fault(), /plain word/);
  picks.ends[0].newName = "common_duct";
  assert.equal(picks.fault(), "");
  picks.held.clear();
  assert.match(picks.fault(), /held/);
});

test("a click finds the end it is at, and a goal lies on the centreline", () => {
  assert.equal(nearestEnd(duct().ends, [39, 1, 0]).name, "b");
  assert.equal(nearestEnd(duct().ends, [20, 0, 0]), null);
  assert.deepEqual(onLine([[[0, 0, 0], [10, 0, 0]], [[10, 8, 0]]], [9, 3, 0]), [10, 0, 0]);
});
