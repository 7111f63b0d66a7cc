// Where a hand's tool goes when a pointer, a key or a stick moves it. Vectors are arrays of three, in millimetres.

export const add = (a, b) => a.map((x, i) => x + b[i]);
export const sub = (a, b) => a.map((x, i) => x - b[i]);
export const scale = (a, s) => a.map((x) => x * s);
export const length = (a) => Math.hypot(...a);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

// A look this flat at the level plane would throw the point to the horizon.
const FLAT = 0.12;

// The point of the level plane z = height under a pointer, null where the eye looks along it. ray: origin, direction.
export function onLevel(ray, height) {
  const along = (height - ray.origin[2]) / ray.direction[2];
  if (Math.abs(ray.direction[2]) < FLAT || along <= 0) return null;
  return add(ray.origin, scale(ray.direction, along));
}

// The point under a pointer in the plane through `point` that faces the eye.
export function onPicture(ray, point, forward) {
  const along = dot(sub(point, ray.origin), forward) / dot(ray.direction, forward);
  return add(ray.origin, scale(ray.direction, along));
}

// The junction of shaft and jaws of a tool whose jaws are to be at `point`: `reach` back along the shaft from the port.
export function junctionAt(point, port, reach) {
  const shaft = sub(point, port);
  return sub(point, scale(shaft, reach / length(shaft)));
}

// Where the jaws are of a tool with its junction at `junction`.
export function jawsAt(junction, port, reach) {
  const shaft = sub(junction, port);
  return add(junction, scale(shaft, reach / length(shaft)));
}

// `point` at `depth` from the port: the trocar lets the tool swing, and nothing slides through it.
export function atDepth(point, port, depth) {
  const shaft = sub(point, port);
  return add(port, scale(shaft, depth / length(shaft)));
}

// `point`, at most `leash` away from where the tool really is: a blocked tool does not wind a hand up.
export function leashed(point, tool, leash) {
  const away = sub(point, tool), distance = length(away);
  return distance <= leash ? point : add(tool, scale(away, leash / distance));
}
