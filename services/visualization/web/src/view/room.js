// How near the eye may come: all points must be in the room of the picture that nothing else covers.

const least = (values) => values.reduce((a, b) => Math.min(a, b), Infinity);
const most = (values) => values.reduce((a, b) => Math.max(a, b), -Infinity);

// The whole picture but for a margin. Places in a picture are from -1 to 1, to the right and up.
export const MARGIN = 0.9;
export const WHOLE = { left: -MARGIN, right: MARGIN, bottom: -MARGIN, top: MARGIN };
const LEAST_HEIGHT = 0.6; // of 2: in less, things would be too small to be moved by some millimetres
// Where there is less, panels at the top are looked through; buttons at the bottom are not, as the jaws are taken there.
const OVER_BUTTONS = -0.25;

// The nearest eye to which every point appears within the room. points: coordinates (3,) to the right, up and forward of the look;
// tan: half the picture's width and height at distance 1. Returns the eye in the same coordinates.
export function nearestEye(points, tan, { left, right, bottom, top }) {
  const x = bounds(points.map(([a]) => a), points, left * tan.x, right * tan.x);
  const y = bounds(points.map(([, b]) => b), points, bottom * tan.y, top * tan.y);
  const forward = Math.min(x.forward, y.forward);
  return [x.middle(forward), y.middle(forward), forward];
}

// Along one axis an eye at (e, f) sees a point (p, d) within [low, high] if e >= p - high (d - f) and e <= p - low (d - f).
function bounds(across, points, low, high) {
  const from = most(across.map((p, i) => p - high * points[i][2])), to = least(across.map((p, i) => p - low * points[i][2]));
  return { forward: (to - from) / (high - low), middle: (f) => 0.5 * (from + high * f + to + low * f) };
}

// What of the page lies over its picture.
export const covering = () => [...document.querySelectorAll("#attempt, #practice, #tools li, .hud.bottom :is(.hands > *, .replay, .tools)")];

// The place nearest to where a box (left, top, width, height) is wanted at which it lies on none of those taken; null for none in `view`.
export function freePlace({ left, top, width, height }, taken, view, gap = 6) {
  const shown = taken.filter((box) => box.width && box.height);
  const within = (value, low, high) => Math.max(low, Math.min(value, high));
  const xs = [within(left, view.left, view.right - width), ...shown.flatMap((box) => [box.left - width - gap, box.right + gap])];
  const ys = [within(top, view.top, view.bottom - height), ...shown.flatMap((box) => [box.top - height - gap, box.bottom + gap])];
  const isIn = ([x, y]) => x >= view.left && y >= view.top && x + width <= view.right && y + height <= view.bottom;
  const isFree = ([x, y]) => shown.every((box) => x >= box.right || x + width <= box.left || y >= box.bottom || y + height <= box.top);
  const away = ([x, y]) => Math.hypot(x - left, y - top);
  const places = xs.flatMap((x) => ys.map((y) => [x, y])).filter((place) => isIn(place) && isFree(place));
  return places.length ? places.reduce((best, place) => (away(place) < away(best) ? place : best)) : null;
}

// The room that boxes of the page leave free in a picture `view`, at the round picture's place in its middle: those above the middle
// end at its top, the others at its bottom. Where that is hardly any, boxes at the side are looked past, and then those at the top.
export function roomBeside(view, boxes) {
  const half = 0.5 * Math.min(view.width, view.height), centre = view.left + 0.5 * view.width, share = half / (0.5 * view.width);
  const across = { left: -MARGIN * share, right: MARGIN * share };
  const shown = boxes.filter((box) => box.width && box.height);
  for (const reach of [half, 0]) {
    const { top, bottom } = between(view, shown.filter((box) => box.left < centre + reach && box.right > centre - reach));
    const edge = 0.5 * (1 - MARGIN) * (top - bottom);
    if (top - bottom >= LEAST_HEIGHT) return { ...across, bottom: bottom + edge, top: top - edge };
  }
  return { ...across, bottom: OVER_BUTTONS, top: MARGIN };
}

// What boxes above and below the middle of a picture leave between them.
function between(view, boxes) {
  const upOf = (y) => 1 - (2 * (y - view.top)) / view.height, isHigh = (box) => upOf(0.5 * (box.top + box.bottom)) > 0;
  const top = least([1, ...boxes.filter(isHigh).map((box) => upOf(box.bottom))]);
  return { top, bottom: most([-1, ...boxes.filter((box) => !isHigh(box)).map((box) => upOf(box.top))]) };
}
