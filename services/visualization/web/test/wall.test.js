import assert from "node:assert/strict";
import { test } from "node:test";
import { boundary, refine, vertexNormals, Wall } from "../src/view/wall.js";

function tube(around, along, radius, length) {
  const points = [], triangles = [];
  for (let i = 0; i <= along; i++) {
    for (let j = 0; j < around; j++) {
      const angle = (2 * Math.PI * j) / around;
      points.push((length * i) / along, radius * Math.cos(angle), radius * Math.sin(angle));
    }
  }
  for (let i = 0; i < along; i++) {
    for (let j = 0; j < around; j++) {
      const a = i * around + j, b = i * around + ((j + 1) % around);
      triangles.push(a, b, a + around, b, b + around, a + around);
    }
  }
  return [Float32Array.from(points), Uint32Array.from(triangles)];
}

const radiusAt = (p, i) => Math.hypot(p[3 * i + 1], p[3 * i + 2]);

test("normals of a tube point away from its axis", () => {
  const [points, triangles] = tube(48, 10, 4, 40);
  const normals = vertexNormals(points, triangles, new Float32Array(points.length));
  for (let i = 48; i < points.length / 3 - 48; i++) {
    const radial = (normals[3 * i + 1] * points[3 * i + 1] + normals[3 * i + 2] * points[3 * i + 2]) / radiusAt(points, i);
    assert.ok(radial > 0.99, `vertex ${i}: ${radial}`);
  }
});

test("refining makes four triangles of each and one vertex an edge", () => {
  const [points, triangles] = tube(8, 3, 4, 40);
  const { edges, triangles: fine } = refine(triangles, points.length / 3);
  assert.equal(fine.length, 4 * triangles.length);
  const vertices = points.length / 3, faces = triangles.length / 3;
  assert.equal(edges.length / 2, vertices + faces); // Euler: V - E + F = 0 for a tube
});

test("the open edges of a tube are its two rims", () => {
  const [, triangles] = tube(8, 3, 4, 40);
  assert.equal(boundary(triangles).length, 16);
});

test("new vertices lie much closer to the cylinder than the flat triangles do", () => {
  const [points, triangles] = tube(12, 6, 4, 40);
  const wall = new Wall(points, triangles, 0);
  const flat = 4 * (1 - Math.cos(Math.PI / 12));
  for (let i = points.length / 3; i < wall.count; i++) {
    const x = wall.middle[3 * i];
    if (x < 7 || x > 33) continue; // rims see triangles on one side only
    assert.ok(Math.abs(radiusAt(wall.middle, i) - 4) < 0.25 * flat);
  }
});

test("the wall has its thickness, half to each side, and closed rims", () => {
  const [points, triangles] = tube(24, 6, 4, 40);
  const wall = new Wall(points, triangles, 0.5);
  for (let i = 0; i < wall.count; i++) {
    const x = wall.middle[3 * i];
    if (x < 7 || x > 33) continue;
    assert.ok(Math.abs(radiusAt(wall.positions, i) - radiusAt(wall.positions, i + wall.count) - 0.5) < 0.01);
  }
  assert.equal(wall.rim.length, 2 * 48);
  assert.ok(Math.max(...wall.index) < wall.positions.length / 3);
  for (let r = 0; r < wall.rim.length; r++) {
    const v = 2 * wall.count + 4 * r, out = wall.normals[3 * v];
    assert.ok(wall.positions[3 * v] < 20 ? out < -0.9 : out > 0.9, "rims face away from the duct");
  }
});

test("nodes stay where physics put them", () => {
  const [points, triangles] = tube(10, 4, 4, 40);
  const wall = new Wall(points, triangles, 0.5);
  const bent = points.map((x, i) => x + Math.sin(i));
  wall.update(bent);
  assert.deepEqual(wall.middle.slice(0, points.length), bent);
});

test("a fine mid-surface is drawn as it is", () => {
  const [points, triangles] = tube(40, 40, 4, 40);
  assert.equal(new Wall(points, triangles, 0.5).fine.length, triangles.length);
  const [few, theirs] = tube(24, 30, 4, 40);
  assert.equal(new Wall(few, theirs, 0.5).fine.length, 4 * theirs.length);
});
