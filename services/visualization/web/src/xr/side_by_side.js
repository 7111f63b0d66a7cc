// Both eyes' pictures beside each other, each squeezed to half of the width, as projectors and screens for glasses take them.

import * as THREE from "three";

const APART = 1 / 30; // of the distance of what is looked at: eyes further apart strain

export class SideBySide {
  constructor(view) {
    this.view = view;
    this.on = false;
    this.eyes = new THREE.StereoCamera();
  }

  switch(on) {
    const { stage } = this.view;
    this.on = on;
    if (on) stage.draw = () => this.draw();
    else delete stage.draw;
    this.view.ask();
  }

  // Draws as the stage does, once for each eye; what is looked at lies in the plane of the screen.
  draw() {
    const { stage, canvas } = this.view, { camera, renderer, scene } = stage;
    const distance = camera.position.distanceTo(stage.controls.target);
    [scene.fog.near, scene.fog.far] = [distance + 20, 2.6 * distance + 120];
    camera.focus = distance;
    camera.updateMatrixWorld();
    this.eyes.eyeSep = APART * distance;
    this.eyes.update(camera);
    const { clientWidth: width, clientHeight: height } = canvas;
    renderer.setScissorTest(true);
    [this.eyes.cameraL, this.eyes.cameraR].forEach((eye, side) => {
      const box = [(side * width) / 2, 0, width / 2, height];
      renderer.setViewport(...box);
      renderer.setScissor(...box);
      renderer.render(scene, eye);
    });
    renderer.setScissorTest(false);
    renderer.setViewport(0, 0, width, height);
  }
}
