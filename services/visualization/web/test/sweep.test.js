import assert from "node:assert/strict";
import { test } from "node:test";
import { spline, Sweep } from "../src/view/sweep.js";

test("the spline goes through every particle", () => {
  const particles = Float32Array.from({ length: 21 }, (_, i) => Math.sin(1.7 * i));
  const line = spline(particles, 3, new Float32Array(3 * (3 * 6 + 1)));
  for (let i = 0; i < 7; i++) {
    for (let k = 0; k < 3; k++) assert.ok(Math.abs(line[9 * i + k] - particles[3 * i + k]) < 1e-6);
  }
});

test("a tube keeps its radius round a bent line, and a straight one is straight", () => {
  const n = 40, sides = 12, line = new Float32Array(3 * n);
  for (let i = 0; i < n; i++) line.set([Math.cos(0.1 * i), Math.sin(0.1 * i), 0.05 * i], 3 * i);
  const sweep = new Sweep(n, sides);
  sweep.update(line, new Float32Array(n).fill(0.2));
  for (let i = 0; i < n; i++) {
    for (let s = 0; s < sides; s++) {
      const o = 3 * (i * sides + s);
      const arm = Math.hypot(...[0, 1, 2].map((k) => sweep.positions[o + k] - line[3 * i + k]));
      assert.ok(Math.abs(arm - 0.2) < 1e-5);
    }
  }
});

test("particles in one place do not make a hole of NaN", () => {
  const sweep = new Sweep(3, 6);
  sweep.update(new Float32Array(9), new Float32Array(3).fill(1));
  assert.ok(sweep.positions.every(Number.isFinite));
});
