// The three.js stage: renderer, light of the laparoscope, cameras, and what the layout puts on it.

import * as THREE from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { RoomEnvironment } from "three/examples/jsm/environments/RoomEnvironment.js";
import { backdrop } from "./backdrop.js";
import { Bar, Catheter, Duct, ForceArrow, samples, Stone, Tool } from "./bodies.js";
import { MeetingRing } from "./cue.js";
import { lightFrom } from "./gouraud.js";
import { jawsAt } from "../hands/motion.js";
import { Lens } from "./lens.js";
import { nearestEye, WHOLE } from "./room.js";
import { Scope } from "./scope.js";

// The canvas to draw on, and whether the browser draws on the processor (SwiftShader, llvmpipe), where every pixel counts: then edges
// are not smoothed, which is settled with the context, and the context is the one that was asked, since making one takes a processor long.
export function canvasFor(canvas) {
  const asked = canvas.cloneNode();
  const context = asked.getContext("webgl2", { alpha: false, antialias: false });
  const info = context?.getExtension("WEBGL_debug_renderer_info");
  const name = info ? context.getParameter(info.UNMASKED_RENDERER_WEBGL) : "";
  if (/swiftshader|llvmpipe|software|basic render/i.test(name)) {
    canvas.replaceWith(asked);
    return { canvas: asked, context, software: true };
  }
  context?.getExtension("WEBGL_lose_context")?.loseContext();
  return { canvas, software: false };
}

export class Stage {
  // `step`: how finely, see governor.js; `drawnOn`: of `canvasFor`.
  constructor({ canvas, context, software }, step) {
    this.look = step.look;
    this.renderer = new THREE.WebGLRenderer({ canvas, context, antialias: !software, powerPreference: "high-performance" });
    this.renderer.toneMapping = THREE.ACESFilmicToneMapping;
    this.renderer.toneMappingExposure = 1.05;
    this.renderer.shadowMap.enabled = step.shadows;
    this.renderer.shadowMap.type = THREE.PCFShadowMap;
    this.pixelRatio = step.ratio;
    this.scene = new THREE.Scene();
    this.scene.background = new THREE.Color("#0a0505");
    this.scene.fog = new THREE.Fog("#0a0505", 110, 380);
    if (step.look === "wet") this.reflect();
    this.camera = new THREE.PerspectiveCamera(50, 1, 1, 1500);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableDamping = true;
    this.controls.dampingFactor = 0.12;
    this.controls.minDistance = 8;
    this.controls.maxDistance = 420;
    this.controls.addEventListener("start", () => (this.over = null)); // a person looks from elsewhere
    this.room = () => WHOLE; // of the picture, which nothing covers
    this.over = null; // what the eye was placed to see
    this.scope = this.lastScope = null; // the one that is held, and the one that was
    this.onScope = () => {}; // called when one is taken or let go of
    this.light();
    this.bodies = new THREE.Group();
    this.lens = new Lens();
    this.scene.add(this.bodies, this.lens.object);
    this.layout = null;
    this.showForces = this.showRings = true;
    this.showsStrain = false;
    this.sideSign = 1;
    this.sided = false;
    this.prepare();
  }

  // Begins to make what bodies are drawn with, while their shapes are on the way: a processor takes long for each program, and
  // the first picture would wait for one after the other.
  prepare() {
    const small = samples(this.look);
    this.scene.add(small);
    this.renderer.compile(this.scene, this.camera);
    this.scene.remove(small);
  }

  // The room that wet tissue mirrors. Plain materials mirror nothing, and making it takes a processor seconds.
  reflect() {
    const pmrem = new THREE.PMREMGenerator(this.renderer);
    this.scene.environment = pmrem.fromScene(new RoomEnvironment(), 0.04).texture;
    this.scene.environmentIntensity = 0.32;
    pmrem.dispose();
  }

  // A lens with its light beside it, and a weaker second light that throws the shadows.
  light() {
    this.lamp = new THREE.SpotLight("#fff4e6", 0, 0, 0.75, 0.8, 2);
    this.lamp.position.set(4, 3, 0);
    this.lamp.target.position.set(0, 0, -100);
    this.camera.add(this.lamp, this.lamp.target);
    this.scene.add(this.camera, new THREE.HemisphereLight("#ffe9dc", "#3a0d0a", 0.35));
    this.sun = new THREE.DirectionalLight("#ffe8d6", 0.9);
    this.sun.castShadow = this.renderer.shadowMap.enabled;
    this.sun.shadow.mapSize.set(1024, 1024);
    this.sun.shadow.radius = 5;
    this.sun.shadow.bias = -0.0006;
    this.sun.shadow.normalBias = 0.25;
    const box = this.sun.shadow.camera;
    [box.left, box.right, box.bottom, box.top, box.near, box.far] = [-70, 70, -70, 70, 10, 300];
    this.scene.add(this.sun, this.sun.target);
  }

  setLayout(layout) {
    const first = this.layout === null || this.layout.scene !== layout.scene;
    this.bodies.traverse((object) => object.geometry?.dispose());
    this.bodies.clear();
    const bounds = new THREE.Box3().setFromArray(layout.rest);
    for (const name of ["mouth", "clamped"]) layout[`${name}Centre`] = centreOf(layout.rest, layout[name]);
    this.layout = layout;
    this.ghost = null;
    this.duct = new Duct(layout, this.look);
    this.catheter = layout.particles > 1 ? new Catheter(layout, this.look) : null;
    this.bars = layout.bars.map((bar) => new Bar(bar, layout.thickness, this.look));
    this.stones = layout.stones.map((radius, i) => new Stone(radius, i, this.look));
    this.tools = layout.tools.map((shape) => new Tool(shape, this.look));
    this.arrows = layout.tools.map(() => new ForceArrow());
    this.rings = layout.tools.map((shape) => new MeetingRing(shape));
    this.duct.showStrain(this.showsStrain);
    this.bodies.add(backdrop(layout, bounds, this.look), this.duct.object);
    if (this.catheter) this.bodies.add(this.catheter.object);
    for (const body of [...[...this.bars, ...this.stones].map((body) => body.object), ...this.tools.map((tool) => tool.root), ...[...this.arrows, ...this.rings].map((a) => a.object)]) this.bodies.add(body);
    this.frameBounds(bounds);
    if (first) {
      this.dropScope();
      this.lastScope = null;
      this.sideSign = 1;
      this.sided = false;
      this.lookFrom("scope");
    }
  }

  frameBounds(bounds) {
    const { mouthCentre, clampedCentre } = this.layout;
    this.size = bounds.getSize(new THREE.Vector3()).length();
    this.mouth = mouthCentre ?? bounds.max.clone();
    this.axis = mouthCentre && clampedCentre ? mouthCentre.clone().sub(clampedCentre).normalize() : new THREE.Vector3(1, 0, 0);
    this.floor = bounds.min.z;
    this.aim = bounds.getCenter(new THREE.Vector3()).lerp(this.mouth, 0.45);
    this.sun.target.position.copy(this.aim);
    this.sun.position.copy(this.aim).add(new THREE.Vector3(25, 60, 110));
  }

  // A camera that is placed takes the place of the scope; the scope's own button puts one that is held back to its start.
  lookFrom(preset) {
    const held = this.scope !== null;
    this.dropScope();
    this.place(preset);
    if (preset !== "scope") return;
    this.lastScope = null;
    if (held) this.holdScope();
  }

  place(preset) {
    const up = new THREE.Vector3(0, 0, 1);
    const side = new THREE.Vector3().crossVectors(this.axis, up).normalize().multiplyScalar(this.sideSign);
    const s = this.size, aim = this.aim.clone();
    const at = (a, b, c) => aim.clone().addScaledVector(this.axis, a * s).addScaledVector(side, b * s).addScaledVector(up, c * s);
    const places = {
      scope: () => at(0.85, 0.95, 0.95),
      side: () => at(0, 1.75, 0.15),
      top: () => at(0.02, 0.02, 1.9),
      ports: () => at(0.9, 4.6, 3.4),
      mouth: () => {
        aim.copy(this.mouth);
        return this.mouth.clone().addScaledVector(this.axis, 0.62 * s).addScaledVector(up, 0.22 * s).addScaledVector(side, 0.12 * s);
      },
    };
    this.over = null;
    this.camera.position.copy(places[preset]());
    this.controls.target.copy(aim);
    if (preset === "ports") this.controls.target.addScaledVector(up, 0.8 * s);
    this.controls.update();
    if (preset === "scope" && this.jaws) this.lookOver(this.jaws);
  }

  // Gives the picture to a laparoscope: as it was left, or the first time with the look of the preset, its port as high as the others.
  holdScope() {
    if (!this.layout || this.scope) return;
    if (!this.lastScope) {
      this.place("scope");
      this.camera.updateMatrixWorld();
      const [, up, back] = [0, 1, 2].map((i) => new THREE.Vector3().setFromMatrixColumn(this.camera.matrixWorld, i).toArray());
      const heights = this.layout.tools.map(({ port }) => port[2]), height = Math.max(...heights);
      this.lastScope = new Scope({ eye: this.camera.position.toArray(), forward: back.map((x) => -x), up }, height, (eye) => this.clearance(eye));
    }
    this.over = null;
    this.scope = this.lastScope;
    this.controls.enabled = false;
    this.placeScope();
    this.onScope();
  }

  // The eye stays where it is, level again, and turns about what it looks at.
  dropScope() {
    if (!this.scope) return;
    this.scope = null;
    this.controls.enabled = true;
    this.camera.up.set(0, 0, 1);
    this.controls.update();
    this.onScope();
  }

  placeScope() {
    const { eye, right, up, forward } = this.scope.look(), vectors = [right, up, forward.map((x) => -x)];
    this.camera.position.set(...eye);
    this.camera.up.set(...up);
    this.camera.quaternion.setFromRotationMatrix(new THREE.Matrix4().makeBasis(...vectors.map((each) => new THREE.Vector3(...each))));
    this.camera.updateMatrixWorld();
    const away = Math.max(MOST_NEAR_MM, new THREE.Vector3(...forward).dot(this.aim.clone().sub(this.camera.position)));
    this.controls.target.copy(this.camera.position).addScaledVector(new THREE.Vector3(...forward), away);
    this.scopeMoved = true;
  }

  // How far a place (3,) is from the wall as it is drawn, and from the bed below it.
  clearance([x, y, z]) {
    const { positions } = this.duct.wall;
    let least = (z - this.floor) ** 2 * Math.sign(z - this.floor);
    for (let i = 0; i < positions.length; i += 3) {
      least = Math.min(least, (positions[i] - x) ** 2 + (positions[i + 1] - y) ** 2 + (positions[i + 2] - z) ** 2);
    }
    return Math.sign(least) * Math.sqrt(Math.abs(least));
  }

  // Where the eye is, in millimetres, how it is turned (quaternion xyzw), and how far away it looks.
  eye() {
    const { position, quaternion } = this.camera, kept = (x, steps) => Math.round(x * steps) / steps;
    return [...position.toArray().map((x) => kept(x, 100)), ...quaternion.toArray().map((x) => kept(x, 10000)), kept(this.lookDistance(), 10)];
  }

  // Looks as an eye did.
  seeAs([x, y, z, ...turn]) {
    this.over = null;
    this.camera.position.set(x, y, z);
    this.camera.quaternion.fromArray(turn).normalize();
    this.camera.updateMatrixWorld();
    this.controls.target.copy(this.camera.position).addScaledVector(this.camera.getWorldDirection(new THREE.Vector3()), turn[4]);
  }

  // Called once the tools are seen: looks from the side of the duct from which the left tool is on the left of a plain picture.
  takeSides({ poses }) {
    const [left, right] = ["left", "right"].map((name) => this.layout.tools.findIndex((tool) => tool.name === name));
    if (this.sided || !poses.length || !this.layout.tools.every((_, i) => isThere(poses, i))) return;
    this.sided = true;
    this.camera.updateMatrixWorld();
    const across = (i) => (i < 0 ? 0 : new THREE.Vector3(...poses.subarray(7 * i, 7 * i + 3)).project(this.camera).x);
    if (across(left) > across(right)) this.sideSign = -1;
    this.jaws = this.layout.tools.flatMap(({ port, jawLength }, i) => {
      const junction = [...poses.subarray(7 * i, 7 * i + 3)];
      return [junction, jawsAt(junction, port, jawLength)];
    });
    this.lookFrom("scope");
  }

  // Looks as through the scope, from where the mouth and all of `points` (3,), in millimetres, are in the picture's room.
  lookOver(points) {
    if (this.scope) return; // an assistant looks where it is told
    this.over = points;
    const low = points.map(([x, y]) => [x, y, this.mouth.z]); // where they will be lowered to
    const seen = [this.mouth.clone(), ...[...points, ...low].map((point) => new THREE.Vector3(...point))];
    const from = this.camera.position.clone().sub(this.controls.target).normalize();
    const turn = new THREE.Matrix4().lookAt(from, new THREE.Vector3(), this.camera.up); // to the right, up and back
    const back = turn.clone().transpose(), looked = seen.map((point) => point.applyMatrix4(back)).map(({ x, y, z }) => [x, y, -z]);
    const high = Math.tan(THREE.MathUtils.degToRad(0.5 * this.camera.fov));
    const [x, y, forward] = nearestEye(looked, { x: high * this.camera.aspect, y: high }, this.room());
    const depth = looked.reduce((sum, [, , d]) => sum + d, 0) / looked.length;
    this.camera.position.set(x, y, -forward).applyMatrix4(turn);
    this.controls.target.set(x, y, -depth).applyMatrix4(turn);
    this.controls.update();
  }

  // Looks anew over what it looked over last, unless a person has turned the view since.
  lookAgain() {
    if (this.over && this.layout) this.lookOver(this.over);
  }

  update(frame, colourOfForce) {
    this.takeSides(frame);
    this.duct.update(frame);
    this.catheter?.update(frame);
    for (const body of [...this.bars, ...this.stones]) body.update(frame);
    this.tools.forEach((tool, i) => {
      const pose = frame.poses.subarray(7 * i, 7 * i + 7), force = frame.forces.subarray(3 * i, 3 * i + 3);
      tool.root.visible = isThere(frame.poses, i);
      tool.update(pose, frame.jaws[i]);
      this.arrows[i].update(pose, force, colourOfForce(Math.hypot(...force)));
      this.arrows[i].object.visible &&= this.showForces;
      if (this.showRings && tool.root.visible) this.rings[i].update(this.duct.wall, pose);
      else this.rings[i].object.visible = false;
    });
  }

  // Hands of another attempt, half transparent among those of this one; `strength` from 0 to 1, null frame for none.
  showGhost(frame, strength = 0.4) {
    if (!frame) return this.ghost?.forEach(({ root }) => (root.visible = false));
    this.ghost ??= this.layout.tools.map((shape) => {
      const tool = new Tool(shape, this.look);
      tool.root.traverse((object) => object.isMesh && (object.material = ghostly()));
      this.bodies.add(tool.root);
      return tool;
    });
    this.ghost.forEach((tool, i) => {
      tool.root.visible = true;
      tool.update(frame.poses.subarray(7 * i, 7 * i + 7), frame.jaws[i]);
      tool.root.traverse((object) => object.isMesh && (object.material.opacity = strength));
    });
  }

  // Whether a point of the world (3,) is before the eye, and not behind it.
  isAhead(point) {
    return new THREE.Vector3(...point).applyMatrix4(this.camera.matrixWorldInverse).z < 0;
  }

  resize(width, height) {
    this.renderer.setPixelRatio(this.pixelRatio);
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.lens.resize(width, height);
    this.height = height;
    this.lookAgain();
  }

  // Draw more or less finely from now on.
  setStep({ ratio, look, shadows }) {
    this.pixelRatio = ratio;
    this.renderer.setPixelRatio(ratio);
    if (look === this.look && shadows === this.renderer.shadowMap.enabled) return;
    this.look = look;
    this.renderer.shadowMap.enabled = this.sun.castShadow = shadows;
    if (look === "wet" && !this.scene.environment) this.reflect();
    if (this.layout) this.setLayout(this.layout);
  }

  // How far away what is looked at is, in millimetres.
  lookDistance() {
    return this.camera.position.distanceTo(this.controls.target);
  }

  // Millimetres of one pixel of the page at the point looked at.
  mmPerPixel() {
    return (2 * this.lookDistance() * Math.tan(THREE.MathUtils.degToRad(0.5 * this.camera.fov))) / this.height;
  }

  // While a person's hand has the left button, the right one turns the view.
  giveLeftButton(away) {
    const { ROTATE, PAN } = THREE.MOUSE;
    this.controls.mouseButtons.LEFT = away ? null : ROTATE;
    this.controls.mouseButtons.RIGHT = away ? ROTATE : PAN;
    this.controls.touches.ONE = away ? null : THREE.TOUCH.ROTATE;
    this.controls.touches.TWO = away ? null : THREE.TOUCH.DOLLY_PAN;
  }

  // From the eye through a pixel of the page, in millimetres of the world.
  rayAt(x, y) {
    const box = this.renderer.domElement.getBoundingClientRect();
    const mirror = this.mirrored ? -1 : 1;
    const at = new THREE.Vector2(mirror * ((2 * (x - box.left)) / box.width - 1), 1 - (2 * (y - box.top)) / box.height);
    const caster = new THREE.Raycaster();
    caster.setFromCamera(at, this.camera);
    return { origin: caster.ray.origin.toArray(), direction: caster.ray.direction.toArray() };
  }

  // Where a point of the world (3,) in millimetres is on the page.
  pixelOf(point) {
    const box = this.renderer.domElement.getBoundingClientRect();
    const at = new THREE.Vector3(...point).project(this.camera);
    const mirror = this.mirrored ? -1 : 1;
    return { x: box.left + 0.5 * (1 + mirror * at.x) * box.width, y: box.top + 0.5 * (1 - at.y) * box.height };
  }

  forward() {
    return this.camera.getWorldDirection(new THREE.Vector3()).toArray();
  }

  // Right and away as the person sees them, level.
  levelAxes() {
    const right = new THREE.Vector3().setFromMatrixColumn(this.camera.matrixWorld, 0).setZ(0).normalize();
    if (this.mirrored) right.negate();
    const away = new THREE.Vector3(-right.y, right.x, 0).multiplyScalar(this.mirrored ? -1 : 1);
    return { right: right.toArray(), away: away.toArray() };
  }

  // Whether the camera has moved since it was asked last.
  moved() {
    if (!this.scope) return this.controls.update();
    const moved = this.scopeMoved;
    this.scopeMoved = false;
    return moved;
  }

  // Colour the duct by its strain, of the frame shown last, or as flesh.
  showStrain(on, frame) {
    this.showsStrain = on;
    this.duct?.showStrain(on);
    if (frame) this.duct?.update(frame);
  }

  // Waits until everything is drawn; without this the browser draws while the page goes on.
  finish() {
    const gl = this.renderer.getContext();
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
  }

  draw() {
    const distance = this.lookDistance();
    this.lamp.intensity = LAMP * distance ** 2; // as a camera sets its shutter by what it looks at
    [this.scene.fog.near, this.scene.fog.far] = [distance + 20, 2.6 * distance + 120];
    if (this.look === "coarse") lightFrom(this.camera, this.sun, this.scene.fog, distance);
    this.renderer.render(this.scene, this.camera);
  }
}

const LAMP = 2.6; // of the light at the lens, where it looks: it falls off with the square of the distance
const MOST_NEAR_MM = 10; // that a scope looks at, wherever it looks

const ghostly = () => new THREE.MeshBasicMaterial({ color: "#8fd8ff", transparent: true, opacity: 0.4, depthWrite: false });

// Whether the rig has said where tool `i` is: a quaternion is never zero.
const isThere = (poses, i) => poses.subarray(7 * i + 3, 7 * i + 7).some((part) => part !== 0);

function centreOf(rest, nodes) {
  if (!nodes?.length) return null;
  const centre = new THREE.Vector3();
  for (const i of nodes) centre.add(new THREE.Vector3(rest[3 * i], rest[3 * i + 1], rest[3 * i + 2]));
  return centre.divideScalar(nodes.length);
}
