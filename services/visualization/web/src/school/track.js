// A replay's pictures in time, and the tracks that are drawn below them: depth, forces, errors and phases, in step.

import { decodeFrame, decodeHello } from "../view/protocol.js";
import { unpacked } from "./keeper.js";

const NS = "http://www.w3.org/2000/svg";
const TICK_S = 1e-3;

export class Track {
  // seen: from which frame on each eye saw them, as the keeper kept it
  constructor(layout, frames, fromTick, seen = []) {
    this.seen = seen;
    this.layout = layout;
    this.frames = frames;
    const first = fromTick >= 0 ? fromTick : frames[0]?.tick ?? 0;
    this.times = frames.map(({ tick }) => (tick - first) * TICK_S);
  }

  static async load(school, attemptId, fromTick) {
    const answer = await school.ask(`replay/${attemptId}`, { raw: true });
    const { hello, frames } = await unpacked(await answer.arrayBuffer());
    const layout = decodeHello(hello);
    return new Track(layout, frames.map((each) => decodeFrame(each, layout)).filter(Boolean), fromTick, hello.seen);
  }

  get length() {
    return this.times.at(-1) ?? 0;
  }

  // The picture at a second, the last one before it.
  at(second) {
    return this.frames[this.index(second)];
  }

  // From where the picture at a second was seen; null of attempts of which that was not kept.
  eyeAt(second) {
    const at = this.index(second);
    return this.seen.findLast(([from]) => from <= at)?.[1] ?? null;
  }

  index(second) {
    let low = 0, high = this.times.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.times[middle] <= second) low = middle;
      else high = middle - 1;
    }
    return low;
  }
}

export function svg(tag, attributes, ...children) {
  const node = document.createElementNS(NS, tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  node.append(...children);
  return node;
}

// A chart of curves over x: {points: [[x, y], …], kind}, with horizontal lines {y, words, kind}. `onPick(x)` when clicked.
export function chart({ curves, lines = [], dots = [], width = 560, height = 120, xWords = "", yWords = "", label, onPick }) {
  const left = 40, right = width - 8, top = 10, bottom = height - 22;
  const xs = curves.flatMap(({ points }) => points.map(([x]) => x)), ys = curves.flatMap(({ points }) => points.map(([, y]) => y));
  const x0 = Math.min(...xs, 0), x1 = Math.max(...xs, x0 + 1e-9);
  const y0 = Math.min(0, ...ys), y1 = 1.08 * Math.max(...ys, ...lines.map(({ y }) => y), 1e-9);
  const px = (x) => left + ((x - x0) / (x1 - x0)) * (right - left), py = (y) => bottom - ((y - y0) / (y1 - y0)) * (bottom - top);
  const root = svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": label, class: "track" });
  for (const y of [y0, y0 + 0.5 * (y1 - y0), y1 / 1.08]) {
    root.append(svg("line", { x1: left, x2: right, y1: py(y), y2: py(y), class: "grid" }));
    root.append(Object.assign(svg("text", { x: left - 5, y: py(y) + 4, "text-anchor": "end" }), { textContent: short(y) }));
  }
  for (const { y, words, kind } of lines) {
    root.append(svg("line", { x1: left, x2: right, y1: py(y), y2: py(y), class: kind }));
    root.append(Object.assign(svg("text", { x: right, y: py(y) - 3, "text-anchor": "end" }), { textContent: words }));
  }
  for (const { points, kind } of curves) root.append(svg("polyline", { class: `curve ${kind}`, points: points.map(([x, y]) => `${px(x).toFixed(1)},${py(y).toFixed(1)}`).join(" ") }));
  for (const { x, y, kind, words } of dots) {
    const dot = svg("circle", { cx: px(x), cy: py(y), r: 4, class: kind });
    dot.append(Object.assign(svg("title", {}), { textContent: words }));
    root.append(dot);
  }
  root.append(Object.assign(svg("text", { x: right, y: height - 6, "text-anchor": "end" }), { textContent: xWords }));
  root.append(Object.assign(svg("text", { x: left, y: height - 6 }), { textContent: yWords }));
  const cursor = svg("line", { x1: left, x2: left, y1: top, y2: bottom, class: "cursor" });
  root.append(cursor);
  root.place = (x) => {
    const at = px(Math.min(Math.max(x, x0), x1)).toFixed(1);
    cursor.setAttribute("x1", at);
    cursor.setAttribute("x2", at);
  };
  if (onPick) {
    root.addEventListener("click", (event) => {
      const box = root.getBoundingClientRect(), at = ((event.clientX - box.left) / box.width) * width;
      onPick(x0 + ((at - left) / (right - left)) * (x1 - x0));
    });
  }
  return root;
}

function short(value) {
  return Math.abs(value) >= 100 ? value.toFixed(0) : Math.abs(value) >= 10 ? value.toFixed(0) : value.toFixed(value ? 1 : 0);
}
