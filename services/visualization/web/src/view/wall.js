// The duct's wall from its mid-surface: refined once, given its thickness, its cut edge closed. Plain arrays, no three.js.

// Area-weighted unit normals of `points` into `out`.
export function vertexNormals(points, triangles, out) {
  out.fill(0);
  for (let t = 0; t < triangles.length; t += 3) {
    const a = 3 * triangles[t], b = 3 * triangles[t + 1], c = 3 * triangles[t + 2];
    const ux = points[b] - points[a], uy = points[b + 1] - points[a + 1], uz = points[b + 2] - points[a + 2];
    const vx = points[c] - points[a], vy = points[c + 1] - points[a + 1], vz = points[c + 2] - points[a + 2];
    const x = uy * vz - uz * vy, y = uz * vx - ux * vz, z = ux * vy - uy * vx;
    for (const i of [a, b, c]) {
      out[i] += x;
      out[i + 1] += y;
      out[i + 2] += z;
    }
  }
  for (let i = 0; i < out.length; i += 3) {
    const length = Math.hypot(out[i], out[i + 1], out[i + 2]) || 1;
    out[i] /= length;
    out[i + 1] /= length;
    out[i + 2] /= length;
  }
  return out;
}

// Splits every triangle in four. `edges` holds the two ends of each new vertex.
export function refine(triangles, n) {
  const edges = [], index = new Map(), fine = [];
  const middle = (a, b) => {
    const key = a < b ? a * n + b : b * n + a;
    if (!index.has(key)) {
      index.set(key, n + edges.length / 2);
      edges.push(a, b);
    }
    return index.get(key);
  };
  for (let t = 0; t < triangles.length; t += 3) {
    const [a, b, c] = triangles.subarray(t, t + 3);
    const ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
    fine.push(a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca);
  }
  return { edges: Uint32Array.from(edges), triangles: Uint32Array.from(fine) };
}

// Edges that belong to one triangle only, wound as that triangle has them.
export function boundary(triangles) {
  const n = triangles.reduce((most, i) => Math.max(most, i), 0) + 1, open = new Map();
  for (let t = 0; t < triangles.length; t += 3) {
    for (let e = 0; e < 3; e++) {
      const a = triangles[t + e], b = triangles[t + ((e + 1) % 3)];
      if (!open.delete(b * n + a)) open.set(a * n + b, [a, b]);
    }
  }
  return [...open.values()];
}

// Triangles of a mid-surface beyond which they are small enough in a picture as they are.
const REFINED_UP_TO = 3000;

export class Wall {
  // `refined`: every triangle drawn as four, up to so many.
  constructor(rest, triangles, thickness, refined = true) {
    this.coarse = triangles;
    this.half = 0.5 * thickness;
    this.n = rest.length / 3;
    const isRefined = refined && triangles.length <= 3 * REFINED_UP_TO;
    const { edges, triangles: fine } = isRefined ? refine(triangles, this.n) : { edges: new Uint32Array(), triangles };
    this.edges = edges;
    this.fine = fine;
    this.count = this.n + edges.length / 2;
    this.rim = boundary(fine);
    this.coarseNormals = new Float32Array(3 * this.n);
    this.middle = new Float32Array(3 * this.count);
    this.middleNormals = new Float32Array(3 * this.count);
    const vertices = 2 * this.count + 4 * this.rim.length;
    this.positions = new Float32Array(3 * vertices);
    this.normals = new Float32Array(3 * vertices);
    this.rest = new Float32Array(3 * vertices);
    this.index = this.buildIndex();
    this.update(rest);
    this.rest.set(this.positions);
  }

  buildIndex() {
    const outer = Array.from(this.fine), inner = [];
    for (let t = 0; t < this.fine.length; t += 3) {
      inner.push(this.fine[t] + this.count, this.fine[t + 2] + this.count, this.fine[t + 1] + this.count);
    }
    const edge = this.rim.flatMap((_, i) => {
      const v = 2 * this.count + 4 * i;
      return [v, v + 2, v + 1, v + 1, v + 2, v + 3];
    });
    return Uint32Array.from([...outer, ...inner, ...edge]);
  }

  // Point-normal triangles (Vlachos 2001): the middle of each edge's cubic, so the surface still goes through its nodes.
  refinePoints(points) {
    vertexNormals(points, this.coarse, this.coarseNormals);
    const p = this.middle, normals = this.coarseNormals;
    p.set(points);
    for (let e = 0; e < this.edges.length / 2; e++) {
      const a = 3 * this.edges[2 * e], b = 3 * this.edges[2 * e + 1], out = 3 * (this.n + e);
      let wa = 0, wb = 0;
      for (let j = 0; j < 3; j++) {
        const d = points[b + j] - points[a + j];
        wa += d * normals[a + j];
        wb -= d * normals[b + j];
      }
      for (let j = 0; j < 3; j++) {
        p[out + j] = 0.5 * (points[a + j] + points[b + j]) - 0.125 * (wa * normals[a + j] + wb * normals[b + j]);
      }
    }
    vertexNormals(p, this.fine, this.middleNormals);
  }

  update(points) {
    this.refinePoints(points);
    const { middle: p, middleNormals: n, positions, normals, half } = this;
    const size = p.length;
    for (let i = 0; i < size; i++) {
      positions[i] = p[i] + half * n[i];
      positions[size + i] = p[i] - half * n[i];
      normals[i] = n[i];
      normals[size + i] = -n[i];
    }
    this.updateRim(size);
  }

  updateRim(size) {
    const { middle: p, middleNormals: n, positions, normals } = this;
    this.rim.forEach(([i, j], r) => {
      const a = 3 * i, b = 3 * j, out = 2 * size + 12 * r;
      for (let k = 0; k < 3; k++) {
        positions[out + k] = positions[a + k];
        positions[out + 3 + k] = positions[b + k];
        positions[out + 6 + k] = positions[size + a + k];
        positions[out + 9 + k] = positions[size + b + k];
      }
      const d = [p[b] - p[a], p[b + 1] - p[a + 1], p[b + 2] - p[a + 2]];
      const away = [d[1] * n[a + 2] - d[2] * n[a + 1], d[2] * n[a] - d[0] * n[a + 2], d[0] * n[a + 1] - d[1] * n[a]];
      const length = Math.hypot(...away) || 1;
      for (let v = 0; v < 4; v++) for (let k = 0; k < 3; k++) normals[out + 3 * v + k] = away[k] / length;
    });
  }
}
