// A laparoscope as an assistant holds it: it swings about its port, slides in and out, and its lens, which looks aside from the
// shaft, turns about it while the camera's head is kept upright. Millimetres; vectors are arrays of three.

import { add, length, scale, sub } from "../hands/motion.js";

export const ASIDE_RAD = Math.PI / 6; // a lens of 30°, the usual one for a gallbladder
const SWING = Math.tan((50 * Math.PI) / 180); // to all sides; the frame of the picture has no pole within 90°
const LEAST_IN_MM = 15; // what a cannula leaves free
const USUAL_IN_MM = 120; // from where no port can be at the height of the others
export const CLEAR_MM = 8; // nearer, a lens touches tissue and smears

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => scale(a, 1 / length(a));
const mix = (a, s, b, t) => add(scale(a, s), scale(b, t));

export class Scope {
  // It begins with the look of a picture: eye, forward and up (unit vectors at a right angle), the shaft steeper than the look, and
  // the port at `height` where the shaft comes from above. clearance(eye): how far the eye is from what it must not touch.
  constructor({ eye, forward, up }, height, clearance = () => Infinity) {
    const [c, s] = [Math.cos(ASIDE_RAD), Math.sin(ASIDE_RAD)];
    this.clearance = clearance;
    this.shaft = mix(forward, c, up, -s); // at the start, as its two sides are
    this.above = mix(up, c, forward, s);
    this.side = cross(this.shaft, this.above);
    const reach = (height - eye[2]) / -this.shaft[2];
    this.depth = reach > LEAST_IN_MM && Number.isFinite(reach) ? reach : USUAL_IN_MM;
    this.port = sub(eye, scale(this.shaft, this.depth));
    this.swung = [0, 0]; // tangents of the shaft's angles to the right and up, from the start
    this.turned = 0; // of the lens about the shaft, from above to the right
  }

  // Returns eye, right, up and forward of the picture. The least turn that takes the shaft to the lens's look takes the camera's head
  // along, so that the horizon tilts no more than a true one does.
  look() {
    const [x, y] = this.swung;
    const shaft = unit(add(this.shaft, mix(this.side, x, this.above, y)));
    const above = unit(sub(this.above, scale(shaft, dot(this.above, shaft)))), side = cross(shaft, above);
    const aside = mix(above, Math.cos(this.turned), side, Math.sin(this.turned)), axis = cross(shaft, aside);
    const [right, up, forward] = [side, above, shaft].map((vector) => turnAbout(axis, ASIDE_RAD, vector));
    return { eye: add(this.port, scale(shaft, this.depth)), right, up, forward };
  }

  // Swings the shaft by angles (small, in rad) to the right and up of the picture.
  swing(right, up) {
    const swung = [this.swung[0] + right, this.swung[1] + up], far = Math.hypot(...swung);
    this.change({ swung: scale(swung, Math.min(1, SWING / (far || 1))) });
  }

  slide(mm) {
    this.change({ depth: Math.max(LEAST_IN_MM, this.depth + mm) });
  }

  turn(rad) {
    this.turned = (this.turned + rad) % (2 * Math.PI);
  }

  // What would bring the lens into tissue is not done; what leads out of it always is.
  change(to) {
    const before = { swung: this.swung, depth: this.depth }, was = this.clearance(this.look().eye);
    Object.assign(this, to);
    const is = this.clearance(this.look().eye);
    if (is < CLEAR_MM && is < was) Object.assign(this, before);
  }
}

// Rodrigues' formula.
function turnAbout(axis, angle, vector) {
  const c = Math.cos(angle), turned = mix(vector, c, cross(axis, vector), Math.sin(angle));
  return add(turned, scale(axis, (1 - c) * dot(axis, vector)));
}
