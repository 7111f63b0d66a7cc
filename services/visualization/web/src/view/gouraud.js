// Light computed at the vertices, for a computer without a graphics processor, to which every pixel's arithmetic counts; three.js has
// no such material. The lamp is at the eye and falls off with the square of the distance; sun, sky and mist are the stage's. Tones by Narkowicz's fit of ACES (2016).

import * as THREE from "three";

const LIT = { uSun: { value: new THREE.Vector3() }, uUp: { value: new THREE.Vector3() }, uMist: { value: new THREE.Vector2() }, uFar: { value: new THREE.Color() }, uLook: { value: 100 } };

const VERTEX = /* glsl */ `
uniform vec3 uSun, uUp, uFar, uOwn;
uniform vec2 uMist;
uniform float uShine, uLook;
varying vec3 vTone;
void main() {
  vec4 place = modelViewMatrix * vec4(position, 1.0);
  vec3 n = normalize(normalMatrix * normal), eye = normalize(-place.xyz), own = uOwn;
  #ifdef USE_COLOR
    own *= color;
  #endif
  float facing = max(dot(n, eye), 0.0), spot = smoothstep(0.73, 0.99, eye.z) * uLook * uLook / dot(place.xyz, place.xyz);
  vec3 light = 2.6 * spot * facing * vec3(1.0, 0.9, 0.79) + 0.9 * max(dot(n, uSun), 0.0) * vec3(1.0, 0.8, 0.68)
    + 0.35 * mix(vec3(0.04, 0.004, 0.003), vec3(1.0, 0.81, 0.72), 0.5 + 0.5 * dot(n, uUp));
  vec3 x = 0.334 * own * light + uShine * spot * pow(facing, 24.0);
  x = mix(x, uFar, smoothstep(uMist.x, uMist.y, -place.z));
  vTone = pow(clamp(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 0.0, 1.0), vec3(0.4545));
  gl_Position = projectionMatrix * place;
}`;
const PIXEL = /* glsl */ `
uniform float uOpacity;
varying vec3 vTone;
void main() { gl_FragColor = vec4(vTone, uOpacity); }`;

// colour: of the whole, times that of each vertex; shine: of the highlight, 0 to 1.
export function gouraud({ color = "#ffffff", vertexColors = false, shine = 0.2, opacity = 1 }) {
  return new THREE.ShaderMaterial({
    vertexShader: VERTEX, fragmentShader: PIXEL, vertexColors, transparent: opacity < 1,
    uniforms: { ...LIT, uOwn: { value: new THREE.Color(color) }, uShine: { value: shine }, uOpacity: { value: opacity } },
  });
}

// Where sun, sky and mist are, seen from the camera, and how far away it looks. Before each picture.
export function lightFrom(camera, sun, mist, look) {
  LIT.uLook.value = look;
  camera.updateMatrixWorld();
  LIT.uSun.value.subVectors(sun.position, sun.target.position).transformDirection(camera.matrixWorldInverse);
  LIT.uUp.value.set(0, 1, 0).transformDirection(camera.matrixWorldInverse);
  LIT.uMist.value.set(mist.near, mist.far);
  LIT.uFar.value.copy(mist.color);
}
