import assert from "node:assert/strict";
import { test } from "node:test";
import { distanceTo, laidOn, meeting, REACH } from "../src/view/cue.js";
import { nameOf } from "../src/view/keep.js";
import { colourOfStrain, FULL, Strain } from "../src/view/strain.js";

// A floor of two triangles at z = 0, 40 mm wide.
const FLOOR = Float32Array.from([-20, -20, 0, 20, -20, 0, 20, 20, 0, -20, 20, 0]);
const TRIANGLES = Uint32Array.from([0, 1, 2, 0, 2, 3]);
const DOWN = [Math.SQRT1_2, 0, Math.SQRT1_2, 0]; // turns x to -z

test("a ray meets a triangle from either side, in front of it, and inside it only", () => {
  const meets = (origin, direction) => distanceTo(FLOOR, 0, 3, 6, origin, direction);
  assert.ok(Math.abs(meets([10, 0, 5], [0, 0, -1]) - 5) < 1e-6);
  assert.ok(Math.abs(meets([10, 0, -5], [0, 0, 1]) - 5) < 1e-6);
  assert.equal(meets([10, 0, 5], [0, 0, 1]), Infinity);
  assert.equal(meets([-10, 15, 5], [0, 0, -1]), Infinity);
  assert.equal(meets([10, 0, 5], [1, 0, 0]), Infinity);
});

test("a tool meets what lies before its tip, as far away as it is; what is far, or beside, it does not", () => {
  const met = meeting(FLOOR, TRIANGLES, [3, -4, 25, ...DOWN], 15);
  assert.ok(Math.abs(met.gap - 10) < 1e-5);
  [3, -4, 0].forEach((wanted, k) => assert.ok(Math.abs(met.at[k] - wanted) < 1e-5));
  assert.equal(meeting(FLOOR, TRIANGLES, [3, -4, 16 + REACH, ...DOWN], 15), null);
  assert.equal(meeting(FLOOR, TRIANGLES, [30, 0, 25, ...DOWN], 15), null);
});

test("the ring lies on the wall, a little above it, as wide as it is said to be", () => {
  const met = meeting(FLOOR, TRIANGLES, [3, -4, 25, ...DOWN], 15), ring = laidOn(FLOOR, TRIANGLES, met, [2, 3], 0.2, []);
  assert.equal(ring.length, 3 * 2 * 28);
  for (let i = 0; i < ring.length; i += 3) {
    assert.ok(Math.abs(Math.hypot(ring[i] - 3, ring[i + 1] + 4) - ((i / 3) % 2 ? 3 : 2)) < 1e-4);
    assert.ok(Math.abs(ring[i + 2] - 0.2) < 1e-4);
  }
});

test("strain is the largest stretch, whichever way it goes, and none where the wall only turns", () => {
  const strain = new Strain(FLOOR, TRIANGLES), at = (map) => [...strain.update(Float32Array.from({ length: 12 }, (_, i) => map(...FLOOR.subarray(3 * Math.floor(i / 3)))[i % 3]))];
  for (const [map, wanted] of [
    [(x, y, z) => [x, y, z], 0], [(x, y) => [0, x, y], 0], [(x, y) => [1.1 * x, y, 0], 0.1], [(x, y) => [x, 1.3 * y, 0], 0.3],
    [(x, y) => [0.5 * x, y, 0], 0], [(x, y) => [x + 0.2 * y, y, 0], Math.sqrt(1.02 + Math.sqrt(1.02 ** 2 - 1)) - 1],
  ]) for (const found of at(map)) assert.ok(Math.abs(found - wanted) < 1e-5, `${found}, not ${wanted}`);
});

test("colours go from one end to the other and not beyond", () => {
  assert.deepEqual(colourOfStrain(-1), colourOfStrain(0));
  assert.deepEqual(colourOfStrain(9), colourOfStrain(FULL));
  assert.notDeepEqual(colourOfStrain(0.5 * FULL), colourOfStrain(FULL));
});

test("a file is called after its time", () => assert.equal(nameOf("png", new Date(0)), "trocar-1970-01-01-00-00-00.png"));
