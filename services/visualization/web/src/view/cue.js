// Where a tool would meet the tissue if it went on along its shaft: a ring on the wall that closes as the tool comes near. A picture
// of one eye has no depth; the ring gives some. Millimetres. Geometry is plain arrays; `MeetingRing` draws.

import * as THREE from "three";

export const REACH = 40; // beyond the tip: what is further away is not aimed at
const SIDES = 28, TOUCHES = 0.4, LIFT = 0.12;

// Distance along `direction` (unit) from `origin` to a triangle, from either side; Infinity for none (Moeller and Trumbore 1997).
export function distanceTo(points, a, b, c, origin, direction) {
  const [ox, oy, oz] = origin, [dx, dy, dz] = direction;
  const ax = points[a], ay = points[a + 1], az = points[a + 2];
  const ux = points[b] - ax, uy = points[b + 1] - ay, uz = points[b + 2] - az;
  const vx = points[c] - ax, vy = points[c + 1] - ay, vz = points[c + 2] - az;
  const px = dy * vz - dz * vy, py = dz * vx - dx * vz, pz = dx * vy - dy * vx;
  const det = ux * px + uy * py + uz * pz;
  if (Math.abs(det) < 1e-12) return Infinity;
  const sx = ox - ax, sy = oy - ay, sz = oz - az, s = (sx * px + sy * py + sz * pz) / det;
  if (s < 0 || s > 1) return Infinity;
  const qx = sy * uz - sz * uy, qy = sz * ux - sx * uz, qz = sx * uy - sy * ux, t = (dx * qx + dy * qy + dz * qz) / det;
  if (t < 0 || s + t > 1) return Infinity;
  const far = (vx * qx + vy * qy + vz * qz) / det;
  return far >= 0 ? far : Infinity;
}

// The first triangle (by the place of its first index) that a ray meets, and how far away; `among`: only these.
export function firstMet(points, triangles, origin, direction, among = null) {
  let distance = Infinity, triangle = -1;
  const n = among ? among.length : triangles.length / 3;
  for (let i = 0; i < n; i++) {
    const t = among ? among[i] : 3 * i;
    const far = distanceTo(points, 3 * triangles[t], 3 * triangles[t + 1], 3 * triangles[t + 2], origin, direction);
    if (far < distance) [distance, triangle] = [far, t];
  }
  return { distance, triangle };
}

// The triangles within `radius` of a point.
function near(points, triangles, [x, y, z], radius) {
  const found = [];
  for (let t = 0; t < triangles.length; t += 3) {
    const a = 3 * triangles[t];
    if (Math.hypot(points[a] - x, points[a + 1] - y, points[a + 2] - z) < radius) found.push(t);
  }
  return found;
}

export function shaftOf(pose) {
  const [, , , w, x, y, z] = pose;
  return [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)];
}

// The distance of the tip to the point that it would meet, and this point; null if there is none near.
export function meeting(points, triangles, pose, tip) {
  const direction = shaftOf(pose), origin = [pose[0], pose[1], pose[2]];
  const { distance } = firstMet(points, triangles, origin, direction);
  const gap = distance - tip;
  return gap <= REACH ? { gap, direction, at: origin.map((o, k) => o + distance * direction[k]) } : null;
}

// Points of two circles about the shaft, inner and outer, laid on the wall a little above it.
export function laidOn(points, triangles, { at, direction }, radii, lift, out) {
  const among = near(points, triangles, at, 4 * radii[1] + 6);
  const any = Math.abs(direction[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0];
  const across = unit(cross(direction, any)), other = cross(direction, across), back = 4 * radii[1] + 4;
  for (let i = 0; i < SIDES; i++) {
    const angle = (2 * Math.PI * i) / SIDES, c = Math.cos(angle), s = Math.sin(angle);
    radii.forEach((r, j) => {
      const foot = at.map((p, k) => p + r * (c * across[k] + s * other[k]));
      const from = foot.map((p, k) => p - back * direction[k]);
      const { distance } = firstMet(points, triangles, from, direction, among);
      const far = (Number.isFinite(distance) ? distance : back) - lift;
      for (let k = 0; k < 3; k++) out[3 * (2 * i + j) + k] = from[k] + far * direction[k];
    });
  }
  return out;
}

function cross([a, b, c], [x, y, z]) {
  return [b * z - c * y, c * x - a * z, a * y - b * x];
}

function unit(v) {
  const length = Math.hypot(...v) || 1;
  return v.map((x) => x / length);
}

export class MeetingRing {
  constructor(shape) {
    this.tip = shape.jawLength || 0;
    this.radius = shape.jawRadius || 1;
    const geometry = new THREE.BufferGeometry(), index = [];
    for (let i = 0; i < SIDES; i++) {
      const a = 2 * i, b = 2 * ((i + 1) % SIDES);
      index.push(a, a + 1, b, b, a + 1, b + 1);
    }
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(6 * SIDES), 3).setUsage(THREE.DynamicDrawUsage));
    geometry.setIndex(index);
    this.material = new THREE.MeshBasicMaterial({ transparent: true, side: THREE.DoubleSide, depthWrite: false, fog: false, polygonOffset: true, polygonOffsetFactor: -4, polygonOffsetUnits: -8 });
    this.object = new THREE.Mesh(geometry, this.material);
    this.object.frustumCulled = this.object.visible = false;
  }

  // `wall`: as it is drawn; its triangles are of the outer side.
  update({ positions: points, fine: triangles }, pose) {
    const met = meeting(points, triangles, pose, this.tip);
    this.object.visible = met !== null;
    if (!met) return;
    const gap = Math.max(0, met.gap), nearness = 1 - gap / REACH, inner = 0.9 * this.radius + 0.11 * gap;
    const { position } = this.object.geometry.attributes;
    laidOn(points, triangles, met, [inner, inner + 0.45 + 0.02 * gap], LIFT, position.array);
    position.needsUpdate = true;
    this.material.color.set(gap < TOUCHES ? "#ffd479" : "#b8fff0");
    this.material.opacity = 0.35 + 0.6 * nearness * nearness;
  }
}
