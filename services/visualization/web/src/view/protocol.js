// The view protocol of services/visualization/codec.py: hello and frames.

import { t } from "../school/i18n.js";

const HEAD_BYTES = 32;
export const MM = 1000; // the scene is drawn in millimetres

function bytes(base64) {
  return Uint8Array.from(atob(base64), (c) => c.charCodeAt(0)).buffer;
}

export function decodeHello(hello) {
  if (hello.protocol !== "trocar-view/1") throw new Error(t("this page does not know the view protocol {version}", { version: hello.protocol }));
  return {
    epoch: hello.epoch,
    scene: hello.scene,
    rest: new Float32Array(bytes(hello.duct.rest_f32)).map((x) => x * MM),
    triangles: new Uint32Array(bytes(hello.duct.triangles_i32)),
    thickness: hello.duct.thickness_m * MM,
    mouth: hello.duct.mouth,
    clamped: hello.duct.clamped,
    neck: hello.duct.neck ?? false,
    particles: hello.catheter.n_points,
    rods: rods(hello),
    bars: (hello.bars ?? []).map(({ size_m, ...bar }) => ({ ...bar, size: size_m.map((x) => x * MM) })),
    stones: (hello.stones?.radii_m ?? []).map((radius) => radius * MM),
    tools: hello.tools.map((tool) => ({
      name: tool.name,
      port: tool.port_m.map((x) => x * MM),
      shaftRadius: tool.shaft_radius_m * MM,
      parts: tool.parts.map(({ material, profile_m }) => ({ material, profile: profile_m.map((place) => place.map((x) => x * MM)) })),
      jawLength: tool.jaw_length_m * MM, // 0 of a tool without jaws
      jawRadius: tool.jaw_radius_m * MM,
    })),
  };
}

// Between which particles catheter and wire, if it has one, lie, and how thick they are; the catheter's first.
function rods({ catheter, wire }) {
  const tip = Math.max(catheter.n_points - 1 - wire.n_segments, 0);
  const parts = [{ from: 0, to: tip, radius: catheter.radius_m * MM }];
  return wire.n_segments ? [...parts, { from: tip, to: catheter.n_points - 1, radius: wire.radius_m * MM }] : parts;
}

// Returns null for a frame that does not fit the layout.
export function decodeFrame(buffer, layout) {
  const n = layout.rest.length / 3, m = layout.particles, k = layout.tools.length;
  const counts = [3 * n, 3 * m, 7 * k, k, 3 * k, 1, 3 * layout.stones.length];
  const total = counts.reduce((a, b) => a + b, 0);
  if (buffer.byteLength !== HEAD_BYTES + 4 * total) return null;
  const head = new DataView(buffer, 0, HEAD_BYTES);
  let offset = HEAD_BYTES;
  const [points, centreline, poses, jaws, forces, inserted, stones] = counts.map((count) => {
    const part = new Float32Array(buffer, offset, count);
    offset += 4 * count;
    return part;
  });
  for (let i = 0; i < points.length; i++) points[i] *= MM;
  for (let i = 0; i < centreline.length; i++) centreline[i] *= MM;
  for (let i = 0; i < stones.length; i++) stones[i] *= MM;
  for (let i = 0; i < k; i++) for (let j = 0; j < 3; j++) poses[7 * i + j] *= MM;
  return {
    sequence: head.getBigUint64(0, true),
    sent_ns: head.getBigUint64(8, true),
    origin_ns: head.getBigUint64(16, true),
    tick: Number(head.getBigUint64(24, true)),
    points, centreline, poses, jaws, forces, stones,
    inserted_mm: inserted[0] * MM,
  };
}

export function encodeEcho(sequence) {
  const echo = new DataView(new ArrayBuffer(8));
  echo.setBigUint64(0, sequence, true);
  return echo.buffer;
}
