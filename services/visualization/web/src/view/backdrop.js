// Scenery behind the duct, which nothing touches: the bed of the liver and the hilum from which the duct comes.

import * as THREE from "three";
import { tissueMaterial } from "./tissue.js";

function withRest(geometry) {
  geometry.setAttribute("rest", geometry.attributes.position.clone());
  return geometry;
}

function wave(x, y) {
  return Math.sin(0.055 * x + 1.3) * Math.cos(0.07 * y) + 0.5 * Math.sin(0.13 * x - 0.09 * y) + 0.3 * Math.sin(0.21 * y + 2);
}

export function backdrop(layout, bounds) {
  const centre = bounds.getCenter(new THREE.Vector3());
  const bed = new THREE.PlaneGeometry(520, 520, 120, 120);
  const p = bed.attributes.position;
  const floor = bounds.min.z - 26;
  for (let i = 0; i < p.count; i++) {
    const x = p.getX(i), y = p.getY(i), away = Math.hypot(x, y);
    p.setXYZ(i, x + centre.x, y + centre.y, floor + 5 * wave(x, y) + Math.max(0, away - 70) * 0.42);
  }
  bed.computeVertexNormals();
  const liver = tissueMaterial({ colour: "#571f1c", pale: "#7c3a2d", vein: "#3a0f12", grain: 0.42, relief: 0.4, wet: 0.55 });
  const group = new THREE.Group();
  const floorMesh = new THREE.Mesh(withRest(bed), liver);
  floorMesh.receiveShadow = true;
  group.add(floorMesh);
  if (layout.clamped && layout.mouth) group.add(hilum(layout));
  return group;
}

function hilum(layout) {
  const away = new THREE.Vector3().subVectors(layout.clampedCentre, layout.mouthCentre).normalize();
  const ball = new THREE.SphereGeometry(1, 64, 48);
  const p = ball.attributes.position;
  for (let i = 0; i < p.count; i++) {
    const [x, y, z] = [p.getX(i), p.getY(i), p.getZ(i)];
    const size = 1 + 0.07 * wave(28 * x, 26 * y) + 0.05 * Math.sin(5 * z + 3 * x);
    p.setXYZ(i, 17 * x * size, 19 * y * size, 15 * z * size);
  }
  ball.computeVertexNormals();
  const fat = tissueMaterial({ colour: "#a8603f", pale: "#d4a566", vein: "#8a3328", grain: 0.7, relief: 0.3, wet: 0.65 });
  const mesh = new THREE.Mesh(withRest(ball), fat);
  mesh.position.copy(layout.clampedCentre).addScaledVector(away, 14.5).add(new THREE.Vector3(0, 0, -4));
  mesh.receiveShadow = mesh.castShadow = true;
  return mesh;
}
