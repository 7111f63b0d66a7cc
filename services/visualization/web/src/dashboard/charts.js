// Curves over time with uPlot: latency of a path, miss ratio by loop.

import uPlot from "uplot";
import { force, known, share, us } from "./format.js";

const SECONDS = 120;
export const COLOURS = ["#56c5b4", "#6ba8e5", "#eab54d", "#f0695a", "#b79cf2", "#8fd16a", "#d98cc0"];
const css = (name) => () => getComputedStyle(document.documentElement).getPropertyValue(name);
// On an axis of more than a decade or two, lines at all of its round numbers become a grey field: those of decades are left.
const DENSE = 30;
const decades = (u, values) => (values.length && values.at(-1) / values[0] > DENSE ? values.map((v) => (Math.abs(Math.log10(v) - Math.round(Math.log10(v))) < 1e-6 ? v : null)) : values);
const AXIS = { stroke: css("--muted"), grid: { stroke: css("--rule"), width: 1 }, ticks: { show: false }, font: "11px system-ui", size: 52 };
const TIME = { ...AXIS, size: 24, values: (_, ticks) => ticks.map((t) => (t === 0 ? "now" : `${t.toFixed(0)} s`)) };

// A line at `value()` across the plot.
function limitLine(value, label) {
  return (u) => {
    const limit = value();
    if (!known(limit) || limit <= 0) return;
    const y = u.valToPos(limit, "y", true), { left, top, width, height } = u.bbox;
    if (y < top || y > top + height) return;
    const { ctx } = u;
    ctx.save();
    ctx.strokeStyle = ctx.fillStyle = "#f0695a";
    ctx.setLineDash([5, 4]);
    ctx.beginPath();
    ctx.moveTo(left, y);
    ctx.lineTo(left + width, y);
    ctx.stroke();
    ctx.font = `${11 * devicePixelRatio}px system-ui`;
    ctx.textAlign = "left";
    ctx.fillText(label(limit), left + 6, y - 5 * devicePixelRatio);
    ctx.restore();
  };
}

export class TimeChart {
  // names: of the series; options: floor (smallest value of the log axis), ceiling (of an empty plot), top (largest), format, limit()
  constructor(parent, names, { floor, ceiling, top = Infinity, format, limit, limitLabel }) {
    this.parent = parent;
    this.floor = floor;
    const axis = { ...AXIS, grid: { ...AXIS.grid, filter: decades }, values: (_, ticks) => ticks.map((v) => (v === null ? "" : format(v))) };
    const y = {
      distr: 3,
      range: (u) => {
        const [low, high] = logRange(u.data, floor, ceiling, limit());
        return [low, Math.min(high, top)];
      },
    };
    this.plot = new uPlot({
      width: 10, height: 10, padding: [8, 18, 0, 0], cursor: { drag: { x: false } }, legend: { show: false },
      scales: { x: { time: false, range: () => [-SECONDS, 0] }, y },
      axes: [TIME, axis],
      series: [{}, ...names.map((name, i) => ({ label: name, stroke: COLOURS[i % COLOURS.length], width: 1.5, points: { show: false }, spanGaps: false }))],
      hooks: { draw: [limitLine(limit, limitLabel)] },
    }, [[], ...names.map(() => [])], parent);
    new ResizeObserver(() => this.resize()).observe(parent);
    this.resize();
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.parent;
    if (width && height) this.plot.setSize({ width, height });
  }

  set(times, series) {
    const now = times.at(-1);
    this.plot.setData([times.map((t) => t - now), ...series.map((values) => values.map((v) => (known(v) ? Math.max(v, this.floor) : null)))]);
  }
}

function logRange(data, floor, ceiling, limit) {
  let low = Infinity, high = -Infinity;
  for (const values of data.slice(1)) {
    for (const v of values) {
      if (v === null) continue;
      low = Math.min(low, v);
      high = Math.max(high, v);
    }
  }
  if (known(limit)) [low, high] = [Math.min(low, limit), Math.max(high, limit)];
  if (low > high) return [floor, ceiling];
  const decade = (v, round) => 10 ** round(Math.log10(v));
  return [Math.max(floor, decade(low, Math.floor)), Math.max(decade(high * 1.05, Math.ceil), 10 * floor)];
}

export const latencyChart = (parent, limit) =>
  new TimeChart(parent, ["p50", "p99", "p99.9", "max"], {
    floor: 1, ceiling: 10000, format: us, limit, limitLabel: (v) => `p99 limit ${us(v)}`,
  });

export const missChart = (parent, loops, limit) =>
  new TimeChart(parent, loops, {
    floor: 1e-5, ceiling: 1, top: 1, format: share, limit, limitLabel: (v) => `budget ${share(v)}`,
  });

export const forceChart = (parent, tools, limit) =>
  new TimeChart(parent, tools, {
    floor: 1e-3, ceiling: 10, top: 100, format: force, limit, limitLabel: (v) => `limit ${force(v)}`,
  });
