import assert from "node:assert/strict";
import { test } from "node:test";

import { ASIDE_RAD, CLEAR_MM, Scope } from "../src/view/scope.js";

const C = Math.cos(0.6), S = Math.sin(0.6);
const LOOK = { eye: [60, 40, 50], forward: [-C, 0, -S], up: [-S, 0, C] };
const HEIGHT = 115;
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const sub = (a, b) => a.map((x, i) => x - b[i]), length = (a) => Math.sqrt(dot(a, a));
const near = (a, b, within = 1e-9) => a.forEach((x, i) => assert.ok(Math.abs(x - b[i]) < within, `${a} is not ${b}`));
const angle = (a, b) => Math.acos(dot(a, b) / length(a) / length(b));
const poses = [[0.3, 0.2, 1], [-0.9, 0.1, -2.5], [0, -1.1, 3], [0.05, 0.6, 0.4]];
const posed = ([right, up, turned], scope = new Scope(LOOK, HEIGHT)) => {
  scope.swing(right, up);
  scope.turn(turned);
  return scope;
};

test("a scope begins with the look it is given, its shaft from a port as high as asked", () => {
  const scope = new Scope(LOOK, HEIGHT), { eye, up, right, forward } = scope.look();
  near(eye, LOOK.eye);
  near(forward, LOOK.forward);
  near(up, LOOK.up);
  near(right, [0, 1, 0]);
  near([scope.port[2]], [HEIGHT]);
});

test("however it is held, its tip is on a line with its port, and its lens looks 30 degrees aside of that", () => {
  for (const pose of poses) {
    const scope = posed(pose), { eye, right, up, forward } = scope.look();
    near([length(sub(eye, scope.port))], [scope.depth]);
    near([angle(sub(eye, scope.port), forward)], [ASIDE_RAD]);
    near([dot(right, up), dot(up, forward), length(right), length(up)], [0, 0, 1, 1]);
    near([right[1] * up[2] - right[2] * up[1], right[2] * up[0] - right[0] * up[2], right[0] * up[1] - right[1] * up[0]], forward.map((x) => -x)); // not mirrored
  }
});

test("it slides along its shaft, and a turn of its lens moves no tip", () => {
  const scope = posed(poses[0]), before = scope.look();
  scope.slide(12);
  const shaft = sub(scope.look().eye, before.eye);
  near([length(shaft), angle(shaft, sub(before.eye, scope.port))], [12, 0], 1e-6);
  near(scope.look().forward, before.forward);
  scope.slide(-12);
  scope.turn(Math.PI);
  near(scope.look().eye, before.eye);
  near([angle(scope.look().forward, before.forward)], [2 * ASIDE_RAD]); // to the other side of the shaft
});

test("a swing to the right or up moves the tip that way in the picture", () => {
  const scope = new Scope(LOOK, HEIGHT), { eye, right, up } = scope.look();
  scope.swing(0.1, 0);
  assert.ok(dot(sub(scope.look().eye, eye), right) > 0.09 * scope.depth);
  scope.swing(-0.1, 0.1);
  assert.ok(dot(sub(scope.look().eye, eye), up) > 0.08 * scope.depth);
});

test("it swings within the cone of its port, and not into tissue, from which it is always let out", () => {
  const scope = new Scope(LOOK, HEIGHT), start = sub(scope.look().eye, scope.port);
  for (let i = 0; i < 100; i++) scope.swing(0.1, -0.07);
  near([angle(sub(scope.look().eye, scope.port), start)], [(50 * Math.PI) / 180]);
  const held = new Scope(LOOK, HEIGHT, ([, , z]) => z - 20);
  for (let i = 0; i < 100; i++) held.slide(1);
  const { eye } = held.look();
  assert.ok(eye[2] >= 20 + CLEAR_MM && eye[2] < 20 + CLEAR_MM + 1);
  held.clearance = ([, , z]) => z - 25; // the tissue has come nearer
  held.slide(1);
  near(held.look().eye, eye);
  held.slide(-1);
  assert.ok(held.look().eye[2] > eye[2]);
});
