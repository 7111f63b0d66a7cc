// Scenery behind the duct, which nothing touches: the bed of the liver, the common bile duct, and the gallbladder at the neck of a
// duct that is cut at its front.

import * as THREE from "three";
import { Sweep, spline } from "./sweep.js";
import { tissue } from "./tissue.js";

function withRest(geometry) {
  geometry.setAttribute("rest", geometry.attributes.position.clone());
  return geometry;
}

function wave(x, y) {
  return Math.sin(0.055 * x + 1.3) * Math.cos(0.07 * y) + 0.5 * Math.sin(0.13 * x - 0.09 * y) + 0.3 * Math.sin(0.21 * y + 2);
}

// `look`: see governor.js.
export function backdrop(layout, bounds, look) {
  const centre = bounds.getCenter(new THREE.Vector3());
  const bed = new THREE.PlaneGeometry(520, 520, ...(look === "coarse" ? [30, 30] : [90, 90]));
  const p = bed.attributes.position;
  const floor = bounds.min.z - 26;
  for (let i = 0; i < p.count; i++) {
    const x = p.getX(i), y = p.getY(i), away = Math.hypot(x, y);
    p.setXYZ(i, x + centre.x, y + centre.y, floor + 5 * wave(x, y) + Math.max(0, away - 70) * 0.42);
  }
  bed.computeVertexNormals();
  const liver = {
    colour: "#3d1512", pale: "#5a261c", vein: "#2a0a0c", grain: 0.3, relief: 0.14, veins: 0.4, wet: 0.3, roughness: 0.62, shine: 0.12,
  };
  const group = new THREE.Group();
  const floorMesh = tissue(withRest(bed), liver, look);
  floorMesh.receiveShadow = true;
  group.add(floorMesh);
  if (layout.clamped?.length && layout.mouth?.length) group.add(commonDuct(layout, look));
  if (layout.neck && layout.mouth?.length) group.add(gallbladder(layout, look));
  return group;
}

const FINE = { per: 8, sides: 40 }, COARSE = { per: 4, sides: 14 };

// The common bile duct: a wider tube across the held end, sinking into the bed on both sides.
function commonDuct(layout, look) {
  const away = new THREE.Vector3().subVectors(layout.clampedCentre, layout.mouthCentre).normalize();
  const across = new THREE.Vector3().crossVectors(away, new THREE.Vector3(0, 0, 1)).normalize();
  const own = rimRadius(layout, "clamped"), radius = 1.62 * own;
  const places = [-11, -9, -6, -3.6, -1.8, 0, 1.8, 3.6, 6, 9, 11].map((step) => {
    const sink = 0.02 * Math.abs(step) ** 3.25;
    return layout.clampedCentre.clone().addScaledVector(away, 1.08 * own + 0.25 * step * step + 0.35 * step)
      .addScaledVector(across, step * 1.25 * own).add(new THREE.Vector3(0, 0, -sink));
  });
  const flesh = { colour: "#8f4238", pale: "#b4785c", vein: "#631c26", relief: 0.08, grain: 0.7 };
  return tube(places, (i, per) => radius * (1 + 0.025 * Math.sin((4 * i) / per) + 0.02 * Math.sin((1.84 * i) / per + 1)), flesh, look);
}

// The gallbladder: from the neck on along the duct's axis it widens, sinks into the bed and turns aside. Lengths and radii are in
// radii of the neck, so that one 6 mm wide has a gallbladder 7 cm long and 3 cm wide.
const ALONG = [-0.5, 1, 2.5, 5, 9, 14, 19, 22, 23.3, 23.5], WIDE = [1.25, 1.3, 1.9, 2.5, 3.6, 4.7, 4.4, 3, 1.3, 0.02];

function gallbladder(layout, look) {
  const away = new THREE.Vector3().subVectors(layout.mouthCentre, layout.clampedCentre).normalize(), own = rimRadius(layout, "mouth");
  const across = new THREE.Vector3().crossVectors(away, new THREE.Vector3(0, 0, 1)).normalize();
  const places = ALONG.map((s) => layout.mouthCentre.clone().addScaledVector(away, own * s).addScaledVector(across, 0.012 * own * s * Math.max(0, s))
    .add(new THREE.Vector3(0, 0, -own * 4 * (1 - Math.exp(-0.012 * s * s)))));
  const flesh = { colour: "#56695a", pale: "#8f9170", vein: "#6b3030", relief: 0.06, grain: 0.45, veins: 0.8 };
  const radii = spline(WIDE.flatMap((wide) => [own * wide, 0, 0]), FINE.per, new Float32Array(3 * (FINE.per * (WIDE.length - 1) + 1)));
  return tube(places, (i, per) => radii[3 * Math.round((i * FINE.per) / per)], flesh, look);
}

// A tube through places (of three.js); radius(i, per) of ring i, of which there are `per` between two places.
function tube(places, radius, flesh, look) {
  const { per, sides } = look === "coarse" ? COARSE : FINE;
  const line = spline(places.flatMap((place) => place.toArray()), per, new Float32Array(3 * (per * (places.length - 1) + 1)));
  const rings = line.length / 3;
  const sweep = new Sweep(rings, sides);
  sweep.update(line, Float32Array.from({ length: rings }, (_, i) => radius(i, per)));
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(sweep.positions, 3));
  geometry.setIndex(new THREE.BufferAttribute(sweep.index, 1));
  geometry.computeVertexNormals();
  const mesh = tissue(withRest(geometry), flesh, look);
  mesh.receiveShadow = mesh.castShadow = true;
  return mesh;
}

function rimRadius(layout, end) {
  const centre = layout[`${end}Centre`], i = 3 * layout[end][0];
  return Math.hypot(layout.rest[i] - centre.x, layout.rest[i + 1] - centre.y, layout.rest[i + 2] - centre.z);
}
