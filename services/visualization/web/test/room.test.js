import assert from "node:assert/strict";
import { test } from "node:test";

import { freePlace, MARGIN, nearestEye, roomBeside, WHOLE } from "../src/view/room.js";

const TAN = { x: 0.6, y: 0.45 };
const POINTS = [[40, -12, 90], [-25, 3, 120], [0, 30, 70], [12, -30, 100]];
const seenFrom = ([x, y, forward]) => POINTS.map(([a, b, d]) => [(a - x) / (d - forward) / TAN.x, (b - y) / (d - forward) / TAN.y]);

test("the nearest eye has every point in its room, ahead, and two of them at its edges", () => {
  for (const room of [WHOLE, { left: -0.5, right: 0.5, bottom: -0.2, top: 0.7 }, { left: -0.9, right: 0.9, bottom: -0.4, top: 0.1 }]) {
    const eye = nearestEye(POINTS, TAN, room), seen = seenFrom(eye), within = 1e-9;
    for (const [, , d] of POINTS) assert.ok(d > eye[2]);
    for (const [a, b] of seen) {
      assert.ok(a >= room.left - within && a <= room.right + within, `${a} is not within ${room.left} and ${room.right}`);
      assert.ok(b >= room.bottom - within && b <= room.top + within, `${b} is not within ${room.bottom} and ${room.top}`);
    }
    const [across, up] = [seen.map(([a]) => a), seen.map(([, b]) => b)];
    const fills = (values, low, high) => Math.min(...values) < low + 1e-6 && Math.max(...values) > high - 1e-6;
    assert.ok(fills(across, room.left, room.right) || fills(up, room.bottom, room.top), "it could come nearer");
  }
});

test("one point alone is looked at from where it is in the middle of the room", () => {
  const [x, y] = nearestEye([[3, 4, 50]], TAN, WHOLE);
  assert.deepEqual([x, y], [3, 4]);
});

const VIEW = { left: 0, top: 50, width: 1200, height: 600 };
const box = (left, top, width, height) => ({ left, top, width, height, right: left + width, bottom: top + height });

test("what crosses the round picture takes room from it, what is beside does not", () => {
  const panel = box(300, 62, 600, 138), buttons = box(500, 590, 500, 50), corner = box(10, 210, 190, 60);
  const room = roomBeside(VIEW, [panel, buttons, corner, box(0, 0, 0, 0)]);
  const top = 1 - (2 * 150) / 600, bottom = 1 - (2 * 540) / 600, edge = 0.5 * (1 - MARGIN) * (top - bottom);
  for (const [name, value] of Object.entries({ left: -0.45, right: 0.45, top: top - edge, bottom: bottom + edge })) {
    assert.ok(Math.abs(room[name] - value) < 1e-12, `${name}: ${room[name]}, not ${value}`);
  }
});

test("a box at the side is looked past where it would leave hardly any room", () => {
  const panel = box(300, 50, 600, 200), corner = box(200, 260, 200, 140), hint = box(500, 450, 200, 200);
  const room = roomBeside(VIEW, [panel, corner, hint]), [top, bottom] = [1 - (2 * 200) / 600, 1 - (2 * 400) / 600];
  assert.ok(room.top < top && room.top > top - 0.1 && room.bottom > bottom && room.bottom < bottom + 0.1);
});

test("where hardly any room is left, panels at the top are looked past, and buttons at the bottom are not", () => {
  const room = roomBeside(VIEW, [box(300, 50, 600, 290), box(300, 360, 600, 290)]);
  assert.equal(room.top, MARGIN);
  assert.ok(room.bottom > -0.5 && room.top - room.bottom > 1);
});

test("a box that is told of something lies nearest to where it is wanted, on nothing else, and within the picture", () => {
  const view = { ...VIEW, right: 1200, bottom: 650 }, wanted = box(100, 300, 200, 80);
  const places = [[], [box(90, 290, 300, 60)], [box(0, 50, 1200, 290), box(0, 520, 1200, 130)], [box(-20, 200, 900, 300)]];
  for (const taken of places) {
    const [left, top] = freePlace(wanted, taken, view), found = box(left, top, 200, 80);
    assert.ok(left >= view.left && top >= view.top && found.right <= view.right && found.bottom <= view.bottom);
    for (const each of taken) assert.ok(left >= each.right || found.right <= each.left || top >= each.bottom || found.bottom <= each.top);
  }
  assert.deepEqual(freePlace(wanted, [], view), [100, 300]);
  assert.deepEqual(freePlace(wanted, [box(100, 310, 50, 300)], view), [156, 300], "beside is nearer than above");
  assert.deepEqual(freePlace(box(-50, 640, 200, 80), [], view), [0, 570], "what reaches beyond the picture is brought in");
  assert.equal(freePlace(wanted, [box(0, 50, 1200, 600)], view), null);
});
