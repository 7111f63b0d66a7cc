// The round picture of a laparoscope: what is outside is dark. Drawn with the picture; as a layer of the page above it, a browser
// that draws on the processor took half as long again to put the two together.

import * as THREE from "three";

const EDGE = [[0.56, 0], [0.61, 0.55], [0.66, 1], [8, 1]]; // radius over the shorter side, opacity
const SIDES = 64;

const VERTEX = /* glsl */ `
attribute float dark;
uniform vec2 uScale;
varying float vDark;
void main() {
  vDark = dark;
  gl_Position = vec4(position.xy * uScale, 0.0, 1.0);
}`;
const PIXEL = /* glsl */ `
varying float vDark;
void main() { gl_FragColor = vec4(0.012, 0.008, 0.008, vDark); }`;

export class Lens {
  constructor() {
    const places = [], dark = [], index = [];
    EDGE.forEach(([radius, opacity], ring) => {
      for (let s = 0; s < SIDES; s++) {
        const angle = (2 * Math.PI * s) / SIDES, a = ring * SIDES + s, b = ring * SIDES + ((s + 1) % SIDES);
        places.push(radius * Math.cos(angle), radius * Math.sin(angle), 0);
        dark.push(opacity);
        if (ring < EDGE.length - 1) index.push(a, a + SIDES, b, b, a + SIDES, b + SIDES);
      }
    });
    const geometry = new THREE.BufferGeometry().setIndex(index);
    geometry.setAttribute("position", new THREE.Float32BufferAttribute(places, 3));
    geometry.setAttribute("dark", new THREE.Float32BufferAttribute(dark, 1));
    this.scale = new THREE.Vector2(1, 1);
    const material = new THREE.ShaderMaterial({
      vertexShader: VERTEX, fragmentShader: PIXEL, uniforms: { uScale: { value: this.scale } },
      transparent: true, depthTest: false, depthWrite: false, side: THREE.DoubleSide,
    });
    this.object = new THREE.Mesh(geometry, material);
    this.object.frustumCulled = false;
    this.object.renderOrder = 10; // over the arrows of force
  }

  resize(width, height) {
    const shorter = Math.min(width, height);
    this.scale.set((2 * shorter) / width, (2 * shorter) / height);
  }
}
