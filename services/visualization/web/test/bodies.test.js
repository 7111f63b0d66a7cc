import assert from "node:assert/strict";
import { test } from "node:test";
import { Bar, Catheter, smoothRuns, Stone, Tool } from "../src/view/bodies.js";

const SPHERE = [0, 0.4, 0.8, 1.2, 1.57, 2, 2.4, 2.8, Math.PI].map((a) => [-1.5 * Math.cos(a), 1.5 * Math.sin(a)]);
const SHAPE = { port: [0, 0, 150], shaftRadius: 2.5, parts: [{ material: "steel", profile: SPHERE }], jawLength: 0, jawRadius: 0 };

test("a profile is parted where it has an edge, and nowhere else", () => {
  assert.equal(smoothRuns(SPHERE).length, 1);
  assert.deepEqual(smoothRuns([[-260, 2], [-9, 2], [-9, 0]]), [[[-260, 2], [-9, 2]], [[-9, 2], [-9, 0]]]);
});

test("beyond the catheter's tip its wire is drawn, as thin as that", () => {
  const rods = [{ from: 0, to: 6, radius: 0.8 }, { from: 6, to: 9, radius: 0.3 }];
  const centreline = Float32Array.from({ length: 30 }, (_, i) => (i % 3 ? 0 : 60 - i));
  for (const look of ["coarse", "plain"]) {
    const catheter = new Catheter({ rods }, look);
    catheter.update({ centreline });
    const drawn = catheter.object.children.map(({ geometry }) => {
      geometry.computeBoundingBox();
      return geometry.boundingBox;
    });
    drawn.forEach(({ min, max }, i) => {
      const { from, to, radius } = rods[i];
      const wanted = [60 - 3 * from, 60 - 3 * to - 0.8 * radius, radius];
      [max.x, min.x, Math.hypot(max.y, 0)].forEach((value, k) => assert.ok(Math.abs(value - wanted[k]) < 0.1 * radius, `${value}, ${wanted[k]}`));
    });
  }
});

test("a tool has the jaws that it is said to have, and is as thick as it is said to be", () => {
  for (const look of ["coarse", "plain"]) {
    const probe = new Tool(SHAPE, look), forceps = new Tool({ ...SHAPE, jawLength: 15, jawRadius: 1 }, look);
    assert.equal(probe.jaws, null);
    probe.update([1, 2, 3, 1, 0, 0, 0], 0.5);
    forceps.update([1, 2, 3, 1, 0, 0, 0], 0.5);
    assert.deepEqual(forceps.jaws.map((jaw) => jaw.rotation.z), [0.25, -0.25]);
    const sphere = probe.object.children[0].geometry;
    sphere.computeBoundingBox();
    const { min, max } = sphere.boundingBox;
    for (const [value, wanted] of [[min.x, -1.5], [max.x, 1.5], [max.y, 1.5]]) assert.ok(Math.abs(value - wanted) < 1e-2, `${value}`);
  }
});

test("a leg of a clip lies on the wall where it is told, and follows it", () => {
  const told = { nodes: [0, 2, 1], weights: [0.25, 0.25, 0.5], along: [0, 1, 0], outward: [0, 0, 1], size: [9, 1.5, 0.8] };
  const bar = new Bar(told, 1, "coarse"), points = Float32Array.from([0, 0, 4, 4, 0, 4, 0, 8, 4]);
  bar.update({ points });
  assert.deepEqual(bar.object.position.toArray().map((x) => Math.round(1e6 * x) / 1e6), [2, 2, 4.9]);
  bar.object.updateMatrixWorld();
  const corner = bar.object.localToWorld(bar.object.position.clone().set(4.5, 0.4, 0.75));
  assert.deepEqual(corner.toArray().map((x) => Math.round(1e6 * Math.abs(x)) / 1e6), [2.75, 6.5, 5.3]);
});

test("each stone is as large as it is told, and where its frame has it", () => {
  const stones = Float32Array.from([1, 2, 3, -4, -5, -6]);
  [2, 0.5].forEach((radius, i) => {
    const stone = new Stone(radius, i, "coarse");
    stone.update({ stones });
    assert.deepEqual(stone.object.position.toArray(), [...stones.subarray(3 * i, 3 * i + 3)]);
    stone.object.geometry.computeBoundingSphere();
    assert.ok(Math.abs(stone.object.geometry.boundingSphere.radius - radius) < 1e-6);
  });
});
