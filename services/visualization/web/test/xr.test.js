import assert from "node:assert/strict";
import { test } from "node:test";
import { Controllers, look } from "../src/xr/controllers.js";
import { carried, FINEST_MM, placeBefore, stretched, toWorld, turnAlong, WIDEST_MM } from "../src/xr/placement.js";

const near = (found, wanted) => found.forEach((x, i) => assert.ok(Math.abs(x - wanted[i]) < 1e-9, `${found} is not ${wanted}`));
const PLACE = { origin: [10, 20, 30], yaw: 0.4, mmPerMetre: 120 };

test("what is looked at stands before the eyes, upright, in the direction of the look", () => {
  const at = [0, -0.15, -0.5], place = placeBefore([5, 6, 7], at, [1, 1, -3], 100);
  near(toWorld(place, at), [5, 6, 7]);
  const ahead = toWorld(place, [0, -0.15, -1.5]);
  near(ahead.map((x, i) => x - [5, 6, 7][i]), [100 / Math.SQRT2, 100 / Math.SQRT2, 0]);
  near(toWorld(place, [0, 0.85, -0.5]), [5, 6, 107]);
});

test("what one hand holds stays under it", () => {
  const from = [0.1, -0.2, -0.4], to = [0.3, 0.1, -0.6];
  near(toWorld(carried(PLACE, from, to), to), toWorld(PLACE, from));
});

test("what two hands hold stays under both, as far as it may turn about the vertical only", () => {
  const a = [[-0.2, 0, -0.4], [-0.3, 0.1, -0.5]], b = [[0.2, 0, -0.4], [0.35, 0.1, -0.2]];
  const next = stretched(PLACE, [a, b]);
  near(toWorld(next, a[1]), toWorld(PLACE, a[0]));
  near(toWorld(next, b[1]), toWorld(PLACE, b[0]));
  assert.ok(next.mmPerMetre < PLACE.mmPerMetre, "hands that part make it larger");
});

test("scale has ends, and hands that meet change nothing", () => {
  const wide = (from, to) => [[[-from, 0, 0], [-to, 0, 0]], [[from, 0, 0], [to, 0, 0]]];
  assert.equal(stretched(PLACE, wide(0.01, 100)).mmPerMetre, FINEST_MM);
  assert.equal(stretched(PLACE, wide(100, 0.01)).mmPerMetre, WIDEST_MM);
  assert.deepEqual(stretched(PLACE, wide(0.2, 0)), PLACE);
});

test("a controller that turns about where it points turns the instrument, and nodding does not", () => {
  const about = (axis, angle) => [...axis.map((x) => x * Math.sin(angle / 2)), Math.cos(angle / 2)];
  near([turnAlong(about([0, 0, 1], 0.2), about([0, 0, 1], 0.5))], [-0.3]);
  near([turnAlong(about([1, 0, 0], 0.1), about([1, 0, 0], 0.7))], [0]);
  near([turnAlong(about([0, 0, 1], 0.3), about([0, 0, 1], 0.3).map((x) => -x))], [0]);
});

const hand = (position, rest = {}) => ({ position, turn: [0, 0, 0, 1], trigger: 0, squeeze: 0, ...rest });

test("a hand moves its instrument unless it holds the world, and nothing jumps when it begins or comes back", () => {
  const controllers = new Controllers();
  assert.deepEqual(controllers.take({ right: hand([0, 0, 0]) }, PLACE), { place: PLACE, moves: {} });
  const { place, moves } = controllers.take({ right: hand([0, 0.01, 0], { trigger: 0.7 }) }, PLACE);
  assert.equal(place, PLACE);
  near(moves.right.by, [0, 0, 1.2]);
  assert.equal(moves.right.closing, 0.7);
  assert.deepEqual(controllers.take({}, PLACE).moves, {});
  assert.deepEqual(controllers.take({ right: hand([5, 5, 5]) }, PLACE).moves, {}, "it was away");
  const held = controllers.take({ right: hand([5, 5, 6], { squeeze: 1 }) }, PLACE);
  assert.deepEqual(held.moves, {});
  assert.equal(held.place, PLACE, "from the next frame on");
  const moved = controllers.take({ right: hand([5, 6, 6], { squeeze: 1 }) }, PLACE);
  near(moved.place.origin, [10, 20, 30 - 120]);
  assert.deepEqual(controllers.take({ right: hand([5, 6, 6]) }, PLACE).moves, {}, "it has just let go");
});

test("only controllers that are really seen count", () => {
  const pose = { transform: { position: { x: 1, y: 2, z: 3 }, orientation: { x: 0, y: 0, z: 0, w: 1 } } };
  const frame = { getPose: (space) => space.pose };
  const source = (handedness, found) => ({ handedness, gripSpace: { pose: found }, gamepad: { buttons: [{ value: 0.2 }, { value: 0.9 }] } });
  const seen = look(frame, null, [source("left", pose), source("right", { ...pose, emulatedPosition: true }), source("none", pose), { handedness: "right" }]);
  assert.deepEqual(seen, { left: { position: [1, 2, 3], turn: [0, 0, 0, 1], trigger: 0.2, squeeze: 0.9 } });
});
