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

// Of the charts' type, in the page's: its size, a letter's mean width, a line's height, and the room beside it.
const TYPE = 0.85, LETTER = 0.48, LINE = 0.95, GAP = 0.4;

// A chart of curves over x: {points: [[x, y], …], kind}, with horizontal lines {y, words, kind}. `onPick(x)` when clicked.
// It is drawn as wide as it is shown, and `height` times as high as the page's type, so that its words are as large as those
// beside it. `whole`: x are whole numbers.
export function chart({ curves, lines = [], dots = [], height = 11, xWords = "", yWords = "", label, whole = false, onPick }) {
  const root = svg("svg", { role: "img", "aria-label": label, class: "track" });
  const xs = curves.flatMap(({ points }) => points.map(([x]) => x)), ys = curves.flatMap(({ points }) => points.map(([, y]) => y));
  const x0 = whole ? Math.min(...xs) : Math.min(...xs, 0), x1 = Math.max(...xs, x0 + (whole ? 1 : 1e-9));
  const y0 = Math.min(0, ...ys), y1 = y0 + 1.08 * (Math.max(...ys, ...lines.map(({ y }) => y), 1e-9) - y0);
  const told = lines.map((line) => ({ ...line, rows: inRows(line.words) }));
  const letters = Math.max(0, ...told.flatMap(({ rows }) => rows.map((row) => row.length)));
  let at = x0, px = null, back = null;
  const place = (x) => {
    at = Math.min(Math.max(x, x0), x1);
    for (const end of ["x1", "x2"]) root.lastChild?.setAttribute(end, px(at).toFixed(1));
  };
  const draw = (width) => {
    const em = parseFloat(getComputedStyle(document.documentElement).fontSize) || 13, high = Math.round(height * em);
    const left = 3 * em, right = width - 0.6 * em - (letters && (GAP + LETTER * letters) * em), top = 0.8 * em, bottom = high - 2.6 * em;
    px = (x) => left + ((x - x0) / (x1 - x0)) * (right - left);
    back = (pixel) => x0 + ((pixel - left) / (right - left)) * (x1 - x0);
    const py = (y) => bottom - ((y - y0) / (y1 - y0)) * (bottom - top);
    const text = (words, x, y, anchor = "start") => root.append(Object.assign(svg("text", { x, y, "text-anchor": anchor, "font-size": TYPE * em }), { textContent: words }));
    for (const [name, value] of Object.entries({ viewBox: `0 0 ${width} ${high}`, width, height: high })) root.setAttribute(name, value);
    root.replaceChildren();
    for (const y of steps(y0, y1, 3)) {
      root.append(svg("line", { x1: left, x2: right, y1: py(y), y2: py(y), class: "grid" }));
      text(short(y), left - GAP * em, py(y) + 0.3 * em, "end");
    }
    for (const x of steps(x0, x1, Math.min(6, (right - left) / (4 * em)), whole)) text(short(x), px(x), bottom + em, "middle");
    for (const { y, kind } of told) root.append(svg("line", { x1: left, x2: right, y1: py(y), y2: py(y), class: kind }));
    for (const { row, y } of apart(told, py, bottom, LINE * em)) text(row, right + GAP * em, y + 0.3 * em);
    for (const { points, kind } of curves) root.append(svg("polyline", { class: `curve ${kind}`, points: points.map(([x, y]) => `${px(x).toFixed(1)},${py(y).toFixed(1)}`).join(" ") }));
    for (const { x, y, kind, words } of dots) {
      const dot = svg("circle", { cx: px(x), cy: py(y), r: 4, class: kind });
      dot.append(Object.assign(svg("title", {}), { textContent: words }));
      root.append(dot);
    }
    text(xWords, right, high - 0.4 * em, "end");
    text(yWords, left, high - 0.4 * em);
    root.append(svg("line", { x1: left, x2: left, y1: top, y2: bottom, class: "cursor" }));
    place(at);
  };
  draw(560);
  new ResizeObserver(([{ contentRect: { width } }]) => width > 100 && draw(Math.round(width))).observe(root);
  root.place = place;
  if (onPick) root.addEventListener("click", (event) => onPick(back(event.clientX - root.getBoundingClientRect().left)));
  return root;
}

// Words beside a chart in at most two rows of about the same length.
export function inRows(words) {
  const parts = words.split(" ");
  if (words.length < 14 || parts.length < 2) return [words];
  const cuts = parts.slice(1).map((_, i) => [parts.slice(0, i + 1).join(" "), parts.slice(i + 1).join(" ")]);
  const longest = (rows) => Math.max(...rows.map((row) => row.length));
  return cuts.reduce((best, rows) => (longest(rows) < longest(best) ? rows : best));
}

// The rows of lines' words, each at the height of its line, moved down where they would lie on those above.
export function apart(lines, py, bottom, rowHeight) {
  let free = -Infinity;
  const placed = lines.map(({ y, rows }) => ({ rows, y: py(y) })).sort((a, b) => a.y - b.y).flatMap(({ rows, y }) => {
    const first = Math.max(free, y - 0.5 * rowHeight * (rows.length - 1));
    free = first + rowHeight * rows.length;
    return rows.map((row, i) => ({ row, y: first + rowHeight * i }));
  });
  const over = Math.max(0, (placed.at(-1)?.y ?? 0) - bottom);
  return placed.map(({ row, y }) => ({ row, y: y - over }));
}

// About `count` round numbers from `low` to `high`, as marks of an axis; `whole`: whole numbers only.
export function steps(low, high, count, whole = false) {
  const rough = (high - low) / Math.max(1, count), decade = 10 ** Math.floor(Math.log10(rough));
  const step = Math.max(whole ? 1 : 0, [1, 2, 5, 10].find((each) => each * decade >= rough) * decade);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(k * step);
  return found;
}

function short(value) {
  return String(Number(value.toPrecision(3)));
}
