// Wet tissue: a physical material whose colour and fine relief come from noise anchored in the undeformed body.

import * as THREE from "three";

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
vec3 flesh = mix(diffuseColor.rgb, uPale, smoothstep(0.35, 0.75, cloud));
diffuseColor.rgb = mix(flesh, uVein, 0.55 * vein);
`;

// Relief from screen-space derivatives (Mikkelsen 2010): needs neither tangents nor a texture.
const RELIEF = /* glsl */ `
#include <normal_fragment_maps>
float relief = uRelief * (layers(grain * 1.6) + 0.35 * noise3(grain * 6.0) - 0.5 * vein);
vec3 sx = dFdx(-vViewPosition), sy = dFdy(-vViewPosition);
vec3 r1 = cross(sy, normal), r2 = cross(normal, sx);
float det = dot(sx, r1);
normal = normalize(abs(det) * normal - sign(det) * (dFdx(relief) * r1 + dFdy(relief) * r2));
`;

export function tissueMaterial({ colour, pale, vein, grain = 1, relief = 0.12, wet = 0.7, roughness = 0.5 }) {
  const material = new THREE.MeshPhysicalMaterial({
    color: colour, roughness, metalness: 0, clearcoat: wet, clearcoatRoughness: 0.22, envMapIntensity: 0.5,
  });
  material.onBeforeCompile = (shader) => {
    Object.assign(shader.uniforms, {
      uPale: { value: new THREE.Color(pale) }, uVein: { value: new THREE.Color(vein) },
      uGrain: { value: grain }, uRelief: { value: relief },
    });
    shader.vertexShader = shader.vertexShader
      .replace("#include <common>", "#include <common>\nattribute vec3 rest;\nvarying vec3 vRest;")
      .replace("#include <begin_vertex>", "#include <begin_vertex>\nvRest = rest;");
    shader.fragmentShader = shader.fragmentShader
      .replace("#include <common>", `#include <common>\nuniform vec3 uPale, uVein;\nuniform float uGrain, uRelief;\n${NOISE}`)
      .replace("#include <color_fragment>", COLOUR)
      .replace("#include <normal_fragment_maps>", RELIEF);
  };
  return material;
}
