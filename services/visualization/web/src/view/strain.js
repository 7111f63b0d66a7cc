// The duct coloured by how far it is stretched. Plain arrays, no three.js.

export const FULL = 0.2; // of the length: the end of the scale
const STOPS = [[0.16, 0.2, 0.42], [0.13, 0.57, 0.55], [0.99, 0.9, 0.15], [0.86, 0.16, 0.12]];

// Red, green, blue of a strain.
export function colourOfStrain(strain, out = [], at = 0) {
  const place = Math.min(1, Math.max(0, strain / FULL)) * (STOPS.length - 1), i = Math.min(STOPS.length - 2, Math.floor(place));
  for (let k = 0; k < 3; k++) out[at + k] = STOPS[i][k] + (place - i) * (STOPS[i + 1][k] - STOPS[i][k]);
  return out;
}

export const SCALE = `linear-gradient(90deg, ${STOPS.map((stop) => `rgb(${stop.map((c) => Math.round(255 * c)).join(" ")})`).join(", ")})`;

// The largest stretch less one of each node, the mean of its triangles', from where the nodes rest and are.
export class Strain {
  constructor(rest, triangles) {
    this.triangles = triangles;
    this.shapes = new Float32Array(triangles.length); // of each triangle at rest: length of edge 1, and edge 2 along and across it
    this.nodes = new Float32Array(rest.length / 3);
    this.counts = new Float32Array(rest.length / 3);
    for (let t = 0; t < triangles.length; t += 3) this.shapes.set(flat(rest, triangles, t), t);
    for (const node of triangles) this.counts[node]++;
  }

  update(points) {
    const { nodes, counts, triangles, shapes } = this;
    nodes.fill(0);
    for (let t = 0; t < triangles.length; t += 3) {
      const [a, b, c] = flat(points, triangles, t), l = shapes[t], m = shapes[t + 1], h = shapes[t + 2];
      // F maps (l, 0) to (a, 0) and (m, h) to (b, c); the larger eigenvalue of its transpose times itself is the stretch squared.
      const f = a / l, g = (b - f * m) / h, k = c / h, half = 0.5 * (f * f + g * g + k * k);
      const stretch = Math.sqrt(half + Math.sqrt(Math.max(0, half * half - f * f * k * k)));
      for (let e = 0; e < 3; e++) nodes[triangles[t + e]] += stretch - 1;
    }
    for (let i = 0; i < nodes.length; i++) nodes[i] /= counts[i] || 1;
    return nodes;
  }
}

function flat(points, triangles, t) {
  const i = 3 * triangles[t], j = 3 * triangles[t + 1], k = 3 * triangles[t + 2];
  const ux = points[j] - points[i], uy = points[j + 1] - points[i + 1], uz = points[j + 2] - points[i + 2];
  const vx = points[k] - points[i], vy = points[k + 1] - points[i + 1], vz = points[k + 2] - points[i + 2];
  const l = Math.hypot(ux, uy, uz) || 1e-9, m = (ux * vx + uy * vy + uz * vz) / l;
  return [l, m, Math.sqrt(Math.max(1e-18, vx * vx + vy * vy + vz * vz - m * m))];
}
