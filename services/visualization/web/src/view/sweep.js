// A tube swept along a centreline with a frame that does not twist (parallel transport). Plain arrays, no three.js.

// Catmull-Rom through the particles, `per` points a segment, into `out`.
export function spline(points, per, out) {
  const n = points.length / 3;
  let o = 0;
  for (let i = 0; i < n - 1; i++) {
    const a = 3 * Math.max(i - 1, 0), b = 3 * i, c = b + 3, d = 3 * Math.min(i + 2, n - 1);
    for (let s = 0; s < per; s++) {
      const t = s / per, t2 = t * t, t3 = t2 * t;
      for (let k = 0; k < 3; k++) {
        out[o++] = 0.5 * (2 * points[b + k] + (points[c + k] - points[a + k]) * t
          + (2 * points[a + k] - 5 * points[b + k] + 4 * points[c + k] - points[d + k]) * t2
          + (3 * points[b + k] - points[a + k] - 3 * points[c + k] + points[d + k]) * t3);
      }
    }
  }
  for (let k = 0; k < 3; k++) out[o++] = points[3 * n - 3 + k];
  return out;
}

function anyNormal(t, out) {
  const k = Math.abs(t[0]) < 0.6 ? 0 : 1;
  const e = [0, 0, 0];
  e[k] = 1;
  const d = t[k];
  for (let j = 0; j < 3; j++) out[j] = e[j] - d * t[j];
  normalise(out);
}

function normalise(v) {
  const length = Math.hypot(v[0], v[1], v[2]) || 1;
  v[0] /= length;
  v[1] /= length;
  v[2] /= length;
}

// Rings of `sides` vertices round `line` (n, 3) with `radii` (n,), into positions and normals.
export class Sweep {
  constructor(n, sides) {
    this.n = n;
    this.sides = sides;
    this.positions = new Float32Array(3 * n * sides);
    this.normals = new Float32Array(3 * n * sides);
    this.cosine = Float32Array.from({ length: sides }, (_, s) => Math.cos((2 * Math.PI * s) / sides));
    this.sine = Float32Array.from({ length: sides }, (_, s) => Math.sin((2 * Math.PI * s) / sides));
    this.index = this.buildIndex();
  }

  buildIndex() {
    const index = [];
    for (let i = 0; i < this.n - 1; i++) {
      for (let s = 0; s < this.sides; s++) {
        const a = i * this.sides + s, b = i * this.sides + ((s + 1) % this.sides);
        index.push(a, b, a + this.sides, b, b + this.sides, a + this.sides);
      }
    }
    return Uint32Array.from(index);
  }

  update(line, radii) {
    const t = [0, 0, 0], u = [0, 0, 0], w = [0, 0, 0];
    for (let i = 0; i < this.n; i++) {
      const before = 3 * Math.max(i - 1, 0), after = 3 * Math.min(i + 1, this.n - 1);
      for (let k = 0; k < 3; k++) t[k] = line[after + k] - line[before + k];
      normalise(t);
      if (i === 0) anyNormal(t, u);
      const along = u[0] * t[0] + u[1] * t[1] + u[2] * t[2];
      for (let k = 0; k < 3; k++) u[k] -= along * t[k];
      normalise(u);
      w[0] = t[1] * u[2] - t[2] * u[1];
      w[1] = t[2] * u[0] - t[0] * u[2];
      w[2] = t[0] * u[1] - t[1] * u[0];
      this.ring(i, line, radii[i], u, w);
    }
  }

  ring(i, line, radius, u, w) {
    for (let s = 0; s < this.sides; s++) {
      const o = 3 * (i * this.sides + s);
      for (let k = 0; k < 3; k++) {
        const normal = this.cosine[s] * u[k] + this.sine[s] * w[k];
        this.normals[o + k] = normal;
        this.positions[o + k] = line[3 * i + k] + radius * normal;
      }
    }
  }
}
