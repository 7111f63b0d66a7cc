// The bodies that move: duct, catheter, tools, force arrows. Millimetres.

import * as THREE from "three";
import { gouraud } from "./gouraud.js";
import { colourOfStrain, Strain } from "./strain.js";
import { Sweep, spline } from "./sweep.js";
import { tissue } from "./tissue.js";
import { Wall } from "./wall.js";

const UP = new THREE.Vector3(0, 1, 0);
// Points of the catheter between two particles, sides of what is round, rings of a jaw.
const FINE = { perSegment: 3, sides: 14, round: 28, rings: 64, arcs: 10 };
const COARSE = { perSegment: 2, sides: 7, round: 8, rings: 12, arcs: 4 };

// `look`: see governor.js.
function fineness(look) {
  return look === "coarse" ? COARSE : FINE;
}

function dynamic(array) {
  return new THREE.BufferAttribute(array, 3).setUsage(THREE.DynamicDrawUsage);
}

export class Duct {
  constructor(layout, look) {
    this.wall = new Wall(layout.rest, layout.triangles, layout.thickness, look !== "coarse");
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", dynamic(this.wall.positions));
    geometry.setAttribute("normal", dynamic(this.wall.normals));
    geometry.setAttribute("rest", new THREE.BufferAttribute(this.wall.rest, 3));
    geometry.setIndex(new THREE.BufferAttribute(this.wall.index, 1));
    this.object = tissue(geometry, { colour: "#b9594f", pale: "#d99a83", vein: "#86283a", relief: 0.08, grain: 0.7 }, look);
    this.object.frustumCulled = false;
    this.object.castShadow = this.object.receiveShadow = true;
    this.flesh = { material: this.object.material, color: geometry.attributes.color };
    this.strain = new Strain(layout.rest, layout.triangles);
    this.stretched = { material: STRETCHED[look](), color: dynamic(new Float32Array(this.wall.positions.length)) };
  }

  // Coloured by how far it is stretched, or as flesh.
  showStrain(on) {
    const { material, color } = on ? this.stretched : this.flesh;
    this.object.material = material;
    if (color) this.object.geometry.setAttribute("color", color);
    this.strained = on;
  }

  update(frame) {
    this.wall.update(frame.points);
    this.object.geometry.attributes.position.needsUpdate = true;
    this.object.geometry.attributes.normal.needsUpdate = true;
    if (this.strained) this.paintStrain(frame.points);
  }

  paintStrain(points) {
    const nodes = this.strain.update(points), { edges, count, n, rim } = this.wall, { array } = this.stretched.color;
    const at = (i) => (i < n ? nodes[i] : 0.5 * (nodes[edges[2 * (i - n)]] + nodes[edges[2 * (i - n) + 1]]));
    for (let i = 0; i < count; i++) colourOfStrain(at(i), array, 3 * i);
    array.copyWithin(3 * count, 0, 3 * count);
    rim.forEach(([a, b], r) => [a, b, a, b].forEach((i, v) => colourOfStrain(at(i), array, 6 * count + 12 * r + 3 * v)));
    this.stretched.color.needsUpdate = true;
  }
}

const STRETCHED = {
  wet: () => new THREE.MeshStandardMaterial({ vertexColors: true, roughness: 0.6, envMapIntensity: 0.4 }),
  plain: () => new THREE.MeshPhongMaterial({ vertexColors: true, shininess: 20 }),
  coarse: () => gouraud({ vertexColors: true, shine: 0.1 }),
};

const CAP = [0.97, 0.87, 0.7, 0.5, 0.5]; // rounded tip: radii of the last rings, the last one inside the lumen

const RUBBER = {
  wet: () => new THREE.MeshPhysicalMaterial({ vertexColors: true, roughness: 0.38, clearcoat: 0.6, clearcoatRoughness: 0.25 }),
  plain: () => new THREE.MeshPhongMaterial({ vertexColors: true, shininess: 60 }),
  coarse: () => gouraud({ vertexColors: true, shine: 0.3 }),
};

const CATHETER = { body: "#d8a63c", ring: "#1d1b18", bore: "#2a1f12" }, WIRE = { body: "#b9c0c6", ring: "#b9c0c6", bore: "#b9c0c6" };

// Catheter and wire.
export class Catheter {
  constructor(layout, look) {
    this.rods = layout.rods.map((part, i) => new Rod(part, i ? WIRE : CATHETER, look));
    this.object = new THREE.Group().add(...this.rods.map((rod) => rod.object));
  }

  update(frame) {
    for (const rod of this.rods) rod.update(frame.centreline);
  }
}

class Rod {
  constructor({ from, to, radius }, colours, look) {
    const { perSegment, sides } = fineness(look);
    Object.assign(this, { from, to, radius, colours, perSegment });
    const along = Math.max(2, (to - from) * perSegment + 1);
    this.line = new Float32Array(3 * (along + CAP.length));
    this.radii = new Float32Array(along + CAP.length).fill(this.radius);
    this.along = along;
    this.sweep = new Sweep(along + CAP.length, sides);
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", dynamic(this.sweep.positions));
    geometry.setAttribute("normal", dynamic(this.sweep.normals));
    geometry.setAttribute("color", dynamic(new Float32Array(this.sweep.positions.length)));
    geometry.setIndex(new THREE.BufferAttribute(this.sweep.index, 1));
    const material = RUBBER[look]();
    this.object = new THREE.Mesh(geometry, material);
    this.object.frustumCulled = false;
    this.object.castShadow = this.object.receiveShadow = true;
    this.marked = false;
  }

  update(centreline) {
    const { line, along, radius } = this;
    spline(centreline.subarray(3 * this.from, 3 * (this.to + 1)), this.perSegment, line);
    const tip = 3 * (along - 1), t = [0, 1, 2].map((k) => line[tip + k] - line[tip - 3 + k]);
    const length = Math.hypot(...t) || 1;
    const steps = [0.3, 0.55, 0.72, 0.8, 0.2];
    CAP.forEach((share, i) => {
      for (let k = 0; k < 3; k++) line[tip + 3 * (i + 1) + k] = line[tip + k] + (t[k] / length) * steps[i] * radius;
      this.radii[along + i] = share * radius;
    });
    this.sweep.update(line, this.radii);
    if (!this.marked) this.mark();
    this.object.geometry.attributes.position.needsUpdate = true;
    this.object.geometry.attributes.normal.needsUpdate = true;
  }

  // A ring every centimetre from the tip, as surgeons count the depth; two rings at every fifth.
  mark() {
    const { line, sweep, along } = this;
    const [body, ring, bore] = ["body", "ring", "bore"].map((name) => new THREE.Color(this.colours[name]));
    const colours = this.object.geometry.attributes.color;
    let arc = 0, step = 0;
    for (let i = sweep.n - 1; i >= 0; i--) {
      if (i < along - 1) arc += step = Math.hypot(...[0, 1, 2].map((k) => line[3 * i + k] - line[3 * i + 3 + k]));
      const fromMark = Math.abs(arc - 10 * Math.round(arc / 10));
      const colour = i === sweep.n - 1 ? bore : arc > 5 && fromMark < Math.max(0.55, 0.5 * step) ? ring : body;
      for (let s = 0; s < sweep.sides; s++) colours.setXYZ(i * sweep.sides + s, colour.r, colour.g, colour.b);
    }
    colours.needsUpdate = true;
    this.marked = true;
  }
}

const METAL = {
  wet: {
    steel: new THREE.MeshStandardMaterial({ color: "#b9c0c6", metalness: 0.85, roughness: 0.34, envMapIntensity: 0.9 }),
    sleeve: new THREE.MeshPhysicalMaterial({ color: "#23272c", roughness: 0.55, clearcoat: 0.25, envMapIntensity: 0.6 }),
    cannula: new THREE.MeshStandardMaterial({ color: "#8ea4b8", metalness: 0.2, roughness: 0.4, transparent: true, opacity: 0.45 }),
  },
  plain: {
    steel: new THREE.MeshPhongMaterial({ color: "#8f979e", specular: "#e8eef4", shininess: 90 }),
    sleeve: new THREE.MeshPhongMaterial({ color: "#23272c", specular: "#555b62", shininess: 40 }),
    cannula: new THREE.MeshPhongMaterial({ color: "#8ea4b8", transparent: true, opacity: 0.45 }),
  },
  coarse: {
    steel: gouraud({ color: "#8f979e", shine: 0.5 }),
    sleeve: gouraud({ color: "#23272c", shine: 0.08 }),
    cannula: gouraud({ color: "#8ea4b8", opacity: 0.45 }),
  },
};

// A bar on the wall that follows a point of it: a leg of a clip.
export class Bar {
  constructor({ nodes, weights, along, outward, size }, thickness, look) {
    const [length, width, high] = size, out = new THREE.Vector3(...outward), axis = new THREE.Vector3(...along);
    Object.assign(this, { nodes, weights, out, above: 0.5 * (thickness + high) });
    this.object = new THREE.Mesh(new THREE.BoxGeometry(length, high, width), METAL[look].steel);
    this.object.quaternion.setFromRotationMatrix(new THREE.Matrix4().makeBasis(axis, out, new THREE.Vector3().crossVectors(axis, out)));
    this.object.castShadow = this.object.receiveShadow = true;
  }

  update({ points }) {
    const place = [0, 1, 2].map((k) => this.nodes.reduce((sum, node, i) => sum + this.weights[i] * points[3 * node + k], 0));
    this.object.position.set(...place).addScaledVector(this.out, this.above);
  }
}

const STONE = {
  wet: () => new THREE.MeshPhysicalMaterial({ color: "#8a7a3c", roughness: 0.55, clearcoat: 0.4 }),
  plain: () => new THREE.MeshPhongMaterial({ color: "#8a7a3c", shininess: 25 }),
  coarse: () => gouraud({ color: "#8a7a3c", shine: 0.2 }),
}; // of cholesterol and pigment

// A stone in the duct, the `index`th of a frame.
export class Stone {
  constructor(radius, index, look) {
    this.index = index;
    this.object = solid(new THREE.SphereGeometry(radius, 2 * fineness(look).round, fineness(look).round), STONE[look]());
  }

  update({ stones }) {
    this.object.position.fromArray(stones, 3 * this.index);
  }
}

// A jaw along +x from the hinge: half round outside (+y), flat and toothed inside, blunt at the end.
function jawGeometry(length, radius, { rings, arcs }) {
  const positions = [], index = [];
  for (let i = 0; i <= rings; i++) {
    const x = (length * i) / rings, s = i / rings;
    const end = Math.sqrt(Math.max(0, 1 - Math.max(0, (s - 0.9) / 0.1) ** 2));
    const wide = radius * (1.55 - 0.5 * s) * (0.25 + 0.75 * end), high = radius * (1.25 - 0.25 * s) * (0.3 + 0.7 * end);
    const tooth = s > 0.22 && s < 0.95 ? 0.22 * radius * ((i % 2) * 2 - 1) : 0;
    for (let a = 0; a <= arcs; a++) {
      const angle = (Math.PI * a) / arcs;
      positions.push(x, -0.78 * radius + (high + 0.5 * radius) * Math.sin(angle) * 1.1, wide * Math.cos(angle));
    }
    positions.push(x, -0.9 * radius + tooth, -0.9 * wide, x, -0.9 * radius + tooth, 0.9 * wide);
  }
  const around = arcs + 3;
  for (let i = 0; i < rings; i++) {
    for (let a = 0; a < around; a++) {
      const p = i * around + a, q = i * around + ((a + 1) % around);
      index.push(p, p + around, q, q, p + around, q + around);
    }
  }
  for (let a = 1; a < around - 1; a++) {
    index.push(0, a, a + 1);
    index.push(rings * around, rings * around + a + 1, rings * around + a);
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(positions, 3));
  geometry.setIndex(index);
  const creased = geometry.toNonIndexed();
  creased.computeVertexNormals();
  return creased;
}

function along(geometry, from, to) {
  // A cylinder of three.js stands on y; lay it along x between `from` and `to`.
  return geometry.rotateZ(-Math.PI / 2).translate(0.5 * (from + to), 0, 0);
}

function solid(geometry, material) {
  const mesh = new THREE.Mesh(geometry, material);
  mesh.castShadow = true;
  mesh.receiveShadow = true;
  return mesh;
}

const CREASE_RAD = (35 * Math.PI) / 180;

// The surfaces that a profile of [x, radius] makes when it is turned about x: one between two creases, so that what
// bends little is shaded as round.
export function smoothRuns(profile) {
  const slope = (i) => Math.atan2(profile[i + 1][1] - profile[i][1], profile[i + 1][0] - profile[i][0]);
  const runs = [[profile[0]]];
  for (let i = 1; i < profile.length; i++) {
    runs.at(-1).push(profile[i]);
    if (i + 1 < profile.length && Math.abs(slope(i) - slope(i - 1)) > CREASE_RAD) runs.push([profile[i]]);
  }
  return runs;
}

function lathed(run, round) {
  // A lathe of three.js turns about y; x of the profile is to be x.
  return new THREE.LatheGeometry(run.map(([x, r]) => new THREE.Vector2(r, x)), round).rotateZ(-Math.PI / 2);
}

export class Tool {
  constructor(shape, look) {
    const metal = METAL[look], { steel, cannula } = metal, round = fineness(look).round, r = shape.shaftRadius;
    this.object = new THREE.Group();
    this.port = new THREE.Vector3(...shape.port);
    for (const { material, profile } of shape.parts) {
      for (const run of smoothRuns(profile)) this.object.add(solid(lathed(run, round), metal[material]));
    }
    this.jaws = shape.jawLength > 0 ? this.addJaws(shape, steel, look) : null;
    this.cannula = new THREE.Group();
    this.cannula.add(
      new THREE.Mesh(along(new THREE.CylinderGeometry(1.7 * r, 1.7 * r, 46, round, 1, true), -30, 16), cannula),
      new THREE.Mesh(along(new THREE.CylinderGeometry(3.4 * r, 2.6 * r, 12, round), -42, -30), cannula),
    );
    this.root = new THREE.Group().add(this.object, this.cannula);
  }

  addJaws({ jawLength, jawRadius }, steel, look) {
    const { round } = fineness(look);
    const pin = new THREE.CylinderGeometry(0.95 * jawRadius, 0.95 * jawRadius, 3.9 * jawRadius, round).rotateX(Math.PI / 2);
    const blade = jawGeometry(jawLength, jawRadius, fineness(look));
    const a = solid(blade, steel), other = solid(blade, steel);
    other.rotation.x = Math.PI;
    const b = new THREE.Group().add(other);
    this.object.add(solid(pin, steel), a, b);
    return [a, b];
  }

  // pose: J (3), quaternion wxyz; the tool frame has x along the shaft and y the way jaw A opens.
  update(pose, opening) {
    this.object.position.set(pose[0], pose[1], pose[2]);
    this.object.quaternion.set(pose[4], pose[5], pose[6], pose[3]);
    this.jaws?.forEach((jaw, i) => (jaw.rotation.z = (0.5 - i) * opening));
    this.cannula.position.copy(this.port);
    this.cannula.quaternion.copy(this.object.quaternion);
  }
}

const ARROW = { color: "#7ad7c4", transparent: true, opacity: 0.92, depthTest: false };

// A small object of every material of a look, so that the materials compile before there is a body.
export function samples(look) {
  const geometry = new THREE.BufferGeometry();
  for (const name of ["position", "normal", "color", "rest"]) geometry.setAttribute(name, new THREE.BufferAttribute(new Float32Array(9), 3));
  const materials = [RUBBER[look](), STONE[look](), ...Object.values(METAL[look]), new THREE.MeshBasicMaterial(ARROW)];
  const flesh = tissue(geometry.clone(), { colour: "#b9594f", pale: "#d99a83", vein: "#86283a" }, look);
  return new THREE.Group().add(flesh, ...materials.map((material) => new THREE.Mesh(geometry, material)));
}

const ARROW_MM = 22; // of 1 N; the length grows with the root, so that millinewtons are seen beside newtons

export class ForceArrow {
  constructor() {
    this.material = new THREE.MeshBasicMaterial(ARROW);
    this.stem = new THREE.Mesh(new THREE.CylinderGeometry(0.28, 0.28, 1, 12).translate(0, 0.5, 0), this.material);
    this.head = new THREE.Mesh(new THREE.ConeGeometry(0.85, 2.2, 16).translate(0, 1.1, 0), this.material);
    this.object = new THREE.Group().add(this.stem, this.head);
    this.object.renderOrder = 5;
    this.force = new THREE.Vector3();
  }

  update(pose, force, colour) {
    this.force.set(force[0], force[1], force[2]);
    const length = ARROW_MM * Math.sqrt(this.force.length());
    this.object.visible = length > 0.6;
    if (!this.object.visible) return;
    this.object.position.set(pose[0], pose[1], pose[2]);
    this.object.quaternion.setFromUnitVectors(UP, this.force.normalize());
    this.stem.scale.y = Math.max(0.01, length - 2);
    this.head.position.y = Math.max(0, length - 2);
    this.material.color.set(colour);
  }
}
