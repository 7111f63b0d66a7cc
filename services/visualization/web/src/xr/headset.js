// The view in a headset, by WebXR: the scene stands before the person, larger than it is; controllers hold it or the instruments.

import * as THREE from "three";
import { colourOfForce } from "../view/colours.js";
import { Controllers, look } from "./controllers.js";
import { placeBefore, toWorld } from "./placement.js";

const WIDE_M = 0.6; // how large the duct is at first
const BEFORE_M = [0, -0.15, -0.5]; // where it is, from the eyes
const NEAR_M = 0.02, FAR_M = 60;
const LAMP = [4, 3, 0], LIT = [0, 0, -100]; // the scope's light beside the eyes, in millimetres

// Why there is no headset, empty where there may be one.
export async function whyNone(scope = globalThis) {
  if (!scope.isSecureContext) return "A headset needs the page over https, or from this computer: `trocar keys` makes a certificate.";
  if (!scope.navigator.xr) return "This browser has no WebXR.";
  const has = await scope.navigator.xr.isSessionSupported("immersive-vr").catch(() => false);
  return has ? "" : "No headset is connected.";
}

export class Headset {
  // onChange(): the session began or ended.
  constructor(view, hands, onChange) {
    [this.view, this.hands, this.onChange] = [view, hands, onChange];
    this.dolly = new THREE.Group();
    this.session = null;
  }

  async toggle() {
    if (this.session) return this.session.end();
    await this.begin(await navigator.xr.requestSession("immersive-vr", { optionalFeatures: ["local"] }));
  }

  async begin(session) {
    const { stage } = this.view, { camera, renderer } = stage;
    this.session = session;
    this.kept = { near: camera.near, far: camera.far, position: camera.position.clone(), quaternion: camera.quaternion.clone(), lens: stage.lens.object.visible };
    const forward = stage.controls.target.clone().sub(camera.position).toArray();
    this.controllers = new Controllers();
    stage.scene.add(this.dolly);
    this.dolly.add(camera);
    this.put(placeBefore(stage.controls.target.toArray(), BEFORE_M, forward, stage.size / WIDE_M));
    [camera.near, camera.far] = [NEAR_M, FAR_M]; // of the room, as the eyes are
    stage.lens.object.visible = false;
    stage.controls.enabled = false;
    for (const name of ["draw", "resize", "setStep"]) stage[name] = () => {}; // the session draws, as large as it wants
    renderer.xr.enabled = true;
    renderer.xr.setReferenceSpaceType("local");
    await renderer.xr.setSession(session);
    session.addEventListener("end", () => this.end()); // after three's own, which gives the canvas its size back
    renderer.setAnimationLoop((now, frame) => this.turn(frame));
    this.takeInstruments();
    this.onChange();
  }

  // Whoever may have the instruments has them in the headset, too.
  takeInstruments() {
    const { hands } = this;
    if (hands?.token && hands.address && !hands.link && !document.getElementById("hands").hidden) hands.take();
  }

  put(place) {
    const { camera, lamp } = this.view.stage;
    this.place = place;
    const columns = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((axis) => new THREE.Vector3(...toWorld({ ...place, origin: [0, 0, 0], mmPerMetre: 1 }, axis)));
    this.dolly.quaternion.setFromRotationMatrix(new THREE.Matrix4().makeBasis(...columns));
    this.dolly.position.set(...place.origin);
    this.dolly.scale.setScalar(place.mmPerMetre);
    lamp.position.set(...LAMP).divideScalar(place.mmPerMetre);
    lamp.target.position.set(...LIT).divideScalar(place.mmPerMetre);
    camera.updateMatrixWorld();
  }

  // A frame of the headset.
  turn(frame) {
    if (!frame || !this.session) return;
    const { view } = this, { stage } = view, { renderer, scene, camera } = stage;
    const seen = look(frame, renderer.xr.getReferenceSpace(), this.session.inputSources);
    const { place, moves } = this.controllers.take(seen, this.place);
    if (place !== this.place) this.put(place);
    this.move(moves);
    const shown = view.stream?.take();
    if (shown) {
      stage.update(shown, colourOfForce);
      view.stream.painted(shown);
      view.frames++;
      view.last = shown;
      view.showForcesOf(shown);
    }
    const metres = stage.size / this.place.mmPerMetre;
    [scene.fog.near, scene.fog.far] = [3 * metres + 1, 12 * metres + 8];
    renderer.render(scene, camera);
  }

  // Instruments follow the controllers of their sides while they are taken.
  move(moves) {
    const { hands } = this;
    for (const [side, move] of Object.entries(moves)) {
      const grip = hands?.grips.find((each) => each.name === side);
      if (grip && hands.link) hands.follow(grip, move, (by) => by);
    }
  }

  end() {
    const { view } = this, { stage } = view, { camera, renderer, lamp } = stage, kept = this.kept;
    this.session = null;
    renderer.setAnimationLoop(null);
    renderer.xr.enabled = false;
    for (const name of ["draw", "resize", "setStep"]) delete stage[name];
    stage.scene.add(camera);
    stage.scene.remove(this.dolly);
    [camera.near, camera.far] = [kept.near, kept.far];
    camera.position.copy(kept.position);
    camera.quaternion.copy(kept.quaternion);
    camera.scale.setScalar(1);
    lamp.position.set(...LAMP);
    lamp.target.position.set(...LIT);
    stage.lens.object.visible = kept.lens;
    stage.controls.enabled = true;
    view.resize();
    this.onChange();
  }
}
