// Heat map of lateness: a column per message, a row per bucket, colour by count. Shows drift and two humps, which a percentile hides.

import { us } from "./format.js";

const COLUMNS = 300;
const GUTTER = 52;
const FOOT = 18;
const SCALE = ["#12161b", "#173a44", "#1f6a69", "#4aa878", "#c9c25c", "#f6d477"];
const STRIPES = SCALE.map((hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16)));

function colour(level) {
  const at = Math.min(level, 0.9999) * (STRIPES.length - 1), i = Math.floor(at), f = at - i;
  return STRIPES[i].map((c, k) => Math.round(c + f * (STRIPES[i + 1][k] - c)));
}

const LEVELS = Array.from({ length: 256 }, (_, i) => [...colour(i / 255), 255]);

export class HeatMap {
  constructor(canvas) {
    this.canvas = canvas;
    this.history = new Map();
    this.loop = null;
    this.image = document.createElement("canvas");
    new ResizeObserver(() => this.draw()).observe(canvas);
  }

  add(heat, periods) {
    for (const [loop, { edges_us: edges, counts }] of Object.entries(heat ?? {})) {
      const kept = this.history.get(loop);
      const entry = kept && kept.edges.length === edges.length ? kept : { edges, columns: [] };
      entry.columns.push(counts);
      if (entry.columns.length > COLUMNS) entry.columns.shift();
      entry.period = periods[loop];
      this.history.set(loop, entry);
    }
  }

  show(loop) {
    this.loop = loop;
    this.draw();
  }

  draw() {
    const entry = this.history.get(this.loop), { canvas } = this;
    const ratio = devicePixelRatio, width = Math.round(canvas.clientWidth * ratio), height = Math.round(canvas.clientHeight * ratio);
    if (!width || !height) return;
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const ctx = canvas.getContext("2d");
    ctx.fillStyle = "#12161b";
    ctx.fillRect(0, 0, width, height);
    if (!entry) return;
    this.paint(entry);
    const left = GUTTER * ratio, foot = height - FOOT * ratio;
    ctx.imageSmoothingEnabled = false;
    ctx.drawImage(this.image, left, 4, width - left, foot - 4);
    this.labels(ctx, entry, left, foot, width, ratio);
  }

  paint({ columns, edges }) {
    const rows = columns.at(-1).length;
    Object.assign(this.image, { width: COLUMNS, height: rows });
    const ctx = this.image.getContext("2d"), pixels = ctx.createImageData(COLUMNS, rows);
    const most = Math.log1p(Math.max(1, ...columns.map((column) => Math.max(...column))));
    const start = COLUMNS - columns.length;
    for (let x = 0; x < COLUMNS; x++) {
      for (let row = 0; row < rows; row++) {
        const count = x < start ? 0 : columns[x - start][row] || 0;
        pixels.data.set(LEVELS[count ? Math.round(255 * (0.14 + (0.86 * Math.log1p(count)) / most)) : 0], 4 * ((rows - 1 - row) * COLUMNS + x));
      }
    }
    ctx.putImageData(pixels, 0, 0);
    this.rows = rows;
    this.edges = edges;
  }

  // Height of a lateness in the plot: buckets are as tall as each other.
  place(value, foot) {
    const { edges, rows } = this;
    let i = edges.findIndex((edge) => edge >= value);
    if (i < 0) i = edges.length - 1;
    return foot - ((i + 1) / rows) * (foot - 4);
  }

  labels(ctx, { edges, period }, left, foot, width, ratio) {
    ctx.font = `${11 * ratio}px system-ui`;
    ctx.fillStyle = "#8d9aa8";
    ctx.textAlign = "right";
    for (const value of [1, 10, 100, 1000, 10000, 100000]) {
      if (value < edges[0] || value > edges.at(-1)) continue;
      ctx.fillText(us(value), left - 6, this.place(value, foot) + 4 * ratio);
    }
    ctx.textAlign = "left";
    ctx.fillText("−60 s", left, foot + 13 * ratio);
    ctx.textAlign = "right";
    ctx.fillText("now", width - 2, foot + 13 * ratio);
    if (!period) return;
    const y = this.place(period, foot);
    ctx.strokeStyle = ctx.fillStyle = "#f0695a";
    ctx.setLineDash([5 * ratio, 4 * ratio]);
    ctx.beginPath();
    ctx.moveTo(left, y);
    ctx.lineTo(width, y);
    ctx.stroke();
    ctx.setLineDash([]);
    ctx.fillText("deadline", width - 6, y - 4);
  }
}
