// Wet tissue: a physical material whose colour and fine relief come from noise anchored in the undeformed body.

import * as THREE from "three";
import { gouraud } from "./gouraud.js";

const NOISE = /* glsl */ `
varying vec3 vRest;
float hash3(vec3 p) { p = fract(p * 0.3183099 + 0.1); p *= 17.0; return fract(p.x * p.y * p.z * (p.x + p.y + p.z)); }
float noise3(vec3 x) {
  vec3 i = floor(x), f = fract(x); f = f * f * (3.0 - 2.0 * f);
  return mix(mix(mix(hash3(i), hash3(i + vec3(1, 0, 0)), f.x), mix(hash3(i + vec3(0, 1, 0)), hash3(i + vec3(1, 1, 0)), f.x), f.y),
             mix(mix(hash3(i + vec3(0, 0, 1)), hash3(i + vec3(1, 0, 1)), f.x), mix(hash3(i + vec3(0, 1, 1)), hash3(i + vec3(1, 1, 1)), f.x), f.y), f.z);
}
float layers(vec3 p) { return 0.55 * noise3(p) + 0.3 * noise3(p * 2.03 + 7.1) + 0.15 * noise3(p * 4.1 + 3.7); }
`;

const COLOUR = /* glsl */ `
#include <color_fragment>
vec3 grain = vRest * uGrain;
float cloud = layers(grain * 0.35);
float vein = smoothstep(0.055, 0.0, abs(layers(grain * 0.22 + 11.0) - 0.5)) * smoothstep(0.35, 0.65, noise3(grain * 0.12));
vec3 flesh = mix(diffuseColor.rgb, uPale, 0.7 * smoothstep(0.3, 0.85, cloud));
diffuseColor.rgb = mix(flesh, uVein, 0.55 * uVeins * vein);
`;

// Relief from screen-space derivatives (Mikkelsen 2010): needs neither tangents nor a texture.
const RELIEF = /* glsl */ `
#include <normal_fragment_maps>
float grainPerPixel = length(fwidth(grain)); // what is finer than a pixel would only flicker
float relief = uRelief * (layers(grain * 1.1) * smoothstep(0.5, 0.12, grainPerPixel)
  + 0.3 * noise3(grain * 4.0) * smoothstep(0.16, 0.04, grainPerPixel) - 0.35 * uVeins * vein);
vec3 sx = dFdx(-vViewPosition), sy = dFdy(-vViewPosition);
vec3 r1 = cross(sy, normal), r2 = cross(normal, sx);
float det = dot(sx, r1);
normal = normalize(abs(det) * normal - sign(det) * (dFdx(relief) * r1 + dFdy(relief) * r2));
`;

// The same tissue for a computer without a graphics processor: colours computed once per vertex.
function paint(geometry, { colour, pale, vein, grain = 1 }) {
  const flesh = new THREE.Color(colour), light = new THREE.Color(pale), dark = new THREE.Color(vein), mixed = new THREE.Color();
  const { array: rest, count } = geometry.attributes.rest, colours = new Float32Array(rest.length);
  const wide = 0.35 * grain, fine = 0.22 * grain;
  for (let i = 0; i < count; i++) {
    const x = rest[3 * i], y = rest[3 * i + 1], z = rest[3 * i + 2];
    const cloud = layered(wide * x, wide * y, wide * z);
    const line = Math.abs(layered(fine * x + 11, fine * y + 11, fine * z + 11) - 0.5);
    mixed.copy(flesh).lerp(light, 0.7 * Math.min(1, Math.max(0, (cloud - 0.3) / 0.5)));
    mixed.lerp(dark, 0.5 * Math.max(0, 1 - line / 0.055)).toArray(colours, 3 * i);
  }
  geometry.setAttribute("color", new THREE.BufferAttribute(colours, 3));
}

function plainTissue({ wet = 0.7 }) {
  return new THREE.MeshPhongMaterial({ vertexColors: true, shininess: 70, specular: new THREE.Color("#806a60").multiplyScalar(Math.max(0, wet - 0.25)) });
}

export function layered(x, y, z) {
  return 0.6 * noise(x, y, z) + 0.4 * noise(2.03 * x + 7.1, 2.03 * y + 7.1, 2.03 * z + 7.1);
}

function smooth(t) {
  return t * t * (3 - 2 * t);
}

// This runs four times for each vertex while a person waits for the first picture, so it allocates no array.
function noise(x, y, z) {
  const i = Math.floor(x), j = Math.floor(y), k = Math.floor(z);
  const u = smooth(x - i), v = smooth(y - j), w = smooth(z - k);
  const near = (1 - v) * ((1 - u) * hash(i, j, k) + u * hash(i + 1, j, k)) + v * ((1 - u) * hash(i, j + 1, k) + u * hash(i + 1, j + 1, k));
  const far = (1 - v) * ((1 - u) * hash(i, j, k + 1) + u * hash(i + 1, j, k + 1)) + v * ((1 - u) * hash(i, j + 1, k + 1) + u * hash(i + 1, j + 1, k + 1));
  return (1 - w) * near + w * far;
}

function hash(x, y, z) {
  const s = Math.sin(127.1 * x + 311.7 * y + 74.7 * z) * 43758.5453;
  return s - Math.floor(s);
}

// `kind`: of flesh; `look`: see governor.js.
export function tissue(geometry, kind, look) {
  if (look === "wet") return new THREE.Mesh(geometry, tissueMaterial(kind));
  paint(geometry, kind);
  return new THREE.Mesh(geometry, look === "plain" ? plainTissue(kind) : gouraud({ vertexColors: true, shine: 0.25 }));
}

function tissueMaterial({ colour, pale, vein, grain = 1, relief = 0.12, veins = 1, wet = 0.7, roughness = 0.5, shine = 0.5 }) {
  const material = new THREE.MeshPhysicalMaterial({
    color: colour, roughness, metalness: 0, clearcoat: wet, clearcoatRoughness: 0.22, envMapIntensity: shine,
  });
  material.onBeforeCompile = (shader) => {
    Object.assign(shader.uniforms, {
      uPale: { value: new THREE.Color(pale) }, uVein: { value: new THREE.Color(vein) },
      uGrain: { value: grain }, uRelief: { value: relief }, uVeins: { value: veins },
    });
    shader.vertexShader = shader.vertexShader
      .replace("#include <common>", "#include <common>\nattribute vec3 rest;\nvarying vec3 vRest;")
      .replace("#include <begin_vertex>", "#include <begin_vertex>\nvRest = rest;");
    shader.fragmentShader = shader.fragmentShader
      .replace("#include <common>", `#include <common>\nuniform vec3 uPale, uVein;\nuniform float uGrain, uRelief, uVeins;\n${NOISE}`)
      .replace("#include <color_fragment>", COLOUR)
      .replace("#include <normal_fragment_maps>", RELIEF);
  };
  return material;
}
