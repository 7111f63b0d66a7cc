// How the room of a person with a headset lies in the world of the scene: `origin`, where the room's origin is in millimetres;
// `yaw`, the turn of the room about the vertical; `mmPerMetre`, the scale. A room has x to the right, y up and z back, in metres;
// the world has z up. Vectors are arrays of three.

import { add, scale, sub } from "../hands/motion.js";

export const FINEST_MM = 5, WIDEST_MM = 2000; // of the world in a metre of the room: two hundred times as large, or half

const axes = (yaw) => [[Math.cos(yaw), Math.sin(yaw), 0], [0, 0, 1], [Math.sin(yaw), -Math.cos(yaw), 0]];
const turned = (yaw, [x, y, z]) => axes(yaw).map((axis, i) => scale(axis, [x, y, z][i])).reduce(add);
const middle = (a, b) => scale(add(a, b), 0.5);
const within = (mm) => Math.min(Math.max(mm, FINEST_MM), WIDEST_MM);

// A way of the room, in metres, as one of the world, in millimetres.
export const wayToWorld = ({ yaw, mmPerMetre }, way) => scale(turned(yaw, way), mmPerMetre);

// A point of the room as one of the world.
export const toWorld = (place, point) => add(place.origin, wayToWorld(place, point));

// The place from which `point` of the world is seen at `at` in the room, forward in the level direction of `forward` (3,).
export function placeBefore(point, at, forward, mmPerMetre) {
  const yaw = Math.atan2(-forward[0], forward[1]);
  const place = { origin: [0, 0, 0], yaw, mmPerMetre: within(mmPerMetre) };
  return { ...place, origin: sub(point, wayToWorld(place, at)) };
}

// The world is held by one hand that goes from `from` to `to`: what was under it stays under it.
export const carried = (place, from, to) => ({ ...place, origin: sub(place.origin, wayToWorld(place, sub(to, from))) });

// The world is held by two hands, each [from, to]: it turns about the vertical and grows with them.
export function stretched(place, [a, b]) {
  const [before, now] = [sub(b[0], a[0]), sub(b[1], a[1])];
  const [long, longNow] = [Math.hypot(...before), Math.hypot(...now)];
  if (long < 1e-3 || longNow < 1e-3) return place;
  const angle = ([x, , z]) => Math.atan2(-z, x), isLevel = (way) => Math.hypot(way[0], way[2]) > 1e-3;
  const turn = isLevel(before) && isLevel(now) ? angle(before) - angle(now) : 0;
  const held = toWorld(place, middle(a[0], b[0]));
  const next = { ...place, yaw: place.yaw + turn, mmPerMetre: within((place.mmPerMetre * long) / longNow) };
  return { ...next, origin: sub(held, wayToWorld(next, middle(a[1], b[1]))) };
}

// By how much a controller turned about the axis that it points along, from one quaternion (x, y, z, w) to the next, in radians.
export function turnAlong([ax, ay, az, aw], [bx, by, bz, bw]) {
  const z = aw * bz - az * bw - ax * by + ay * bx, w = aw * bw + ax * bx + ay * by + az * bz;
  const angle = -2 * Math.atan2(z, w); // it points along -z
  return angle - 2 * Math.PI * Math.round(angle / (2 * Math.PI));
}
