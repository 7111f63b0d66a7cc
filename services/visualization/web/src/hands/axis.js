// Axes and buttons of a gamepad: when each was last reported, where it rests, and how far it is pushed.
// The same model as services/gateway/hands/input_axis.py, which says why; both are held to test/axis.json. Times in ms.

import { t } from "../school/i18n.js";

export const REST_MS = 250, PATIENCE_MS = 2000, DEAD = 0.12;
const STILL = 0.06, MIDDLE = 0.2, END = 0.1, HELD_MS = 1000, CENTRED = 0.05, DRIFT_MS = 1000, PRESSED = 0.2;

const within = (x, low, high) => Math.min(Math.max(x, low), high);

export class Axis {
  // reported: time of the newest report; middle, end: value at rest as a stick and as a trigger; null: none, not known
  constructor(low, high, raw) {
    Object.assign(this, { low, high, raw, least: 0, most: 0, still: 0, looked: 0 });
    this.reported = this.middle = this.end = this.began = null;
    this.wasPressed = this.hasReturned = this.isStick = false;
  }

  report(raw, now) {
    const isFirstWord = this.reported === null && this.raw === 0 && raw !== 0;
    [this.raw, this.reported] = [raw, now];
    [this.least, this.most] = [Math.min(this.least, raw), Math.max(this.most, raw)];
    if (this.most - this.least > STILL * (this.high - this.low)) this.begin(now);
    if (isFirstWord && this.middle !== null && this.isNearMiddle(MIDDLE)) this.doubtMiddle(raw, now);
    this.wasPressed ||= this.pressed() > PRESSED;
  }

  // Learns from all values up to now, after they have been reported.
  advance(now) {
    if (this.began === null) {
      this.began = this.looked = now;
      this.begin(now);
    }
    const passed = now - this.looked;
    this.looked = now;
    if (!this.isAtRest(now)) return;
    if (this.middle !== null) this.followMiddle(passed);
    else if (this.end !== null) this.followEnd(passed, now);
    else this.learn();
  }

  isAtRest(now) {
    return this.high > this.low && this.began !== null && now - this.still >= REST_MS;
  }

  // The deflection from the middle, -1 to 1; 0 if it does not rest there.
  stick() {
    if (this.middle === null) return 0;
    const way = this.raw > this.middle ? this.high - this.middle : this.middle - this.low;
    return within((this.raw - this.middle) / way, -1, 1);
  }

  // How far it is pressed from its end, 0 to 1; 0 if it does not rest there. From a high end: after it has come back.
  trigger() {
    return this.hasReturned || this.end === null || this.share(this.end) < 0.5 ? this.pressed() : 0;
  }

  // What keeps it from being used, empty if nothing does or it is too early to tell.
  problem(now) {
    const isEarly = this.began === null || now - this.began < PATIENCE_MS;
    if (isEarly || this.middle !== null || this.end !== null || !(this.high > this.low)) return "";
    const share = (100 * this.share(this.raw)).toFixed(0);
    return this.isAtRest(now) ? t("rests at {share} % of its way, neither in its middle nor at an end", { share }) : t("never rests, and is at {share} % of its way", { share });
  }

  pressed() {
    if (this.end === null) return 0;
    const far = this.share(this.end) > 0.5 ? this.low : this.high;
    return within((this.raw - this.end) / (far - this.end), 0, 1);
  }

  begin(now) {
    this.least = this.most = this.raw;
    this.still = now;
  }

  learn() {
    const rest = 0.5 * (this.least + this.most), share = this.share(rest);
    this.wasPressed = this.hasReturned = false;
    if (Math.abs(share - 0.5) <= MIDDLE) this.middle = rest;
    else if (Math.min(share, 1 - share) <= END && !this.isStick) this.end = rest;
  }

  doubtMiddle(raw, now) {
    if (Math.abs(this.stick()) < DEAD) this.middle = raw;
    else {
      [this.middle, this.isStick] = [null, true];
      this.begin(now);
    }
  }

  followMiddle(passed) {
    if (Math.abs(this.stick()) < DEAD) this.middle = this.followed(this.middle, passed, 0.5, MIDDLE);
  }

  followEnd(passed, now) {
    const isHigh = this.share(this.end) > 0.5;
    if (this.pressed() < DEAD) {
      this.hasReturned ||= this.wasPressed;
      this.end = this.followed(this.end, passed, Number(isHigh), END);
    } else if (this.hasReturned) return;
    else if (isHigh && this.share(this.raw) <= END) this.learn();
    else if (now - (this.reported ?? 0) >= HELD_MS && this.isNearMiddle(CENTRED)) this.middle = this.raw;
  }

  followed(rest, passed, place, by) {
    const at = rest + (this.raw - rest) * Math.min(1, passed / DRIFT_MS), way = this.high - this.low;
    return within(at, this.low + (place - by) * way, this.low + (place + by) * way);
  }

  isNearMiddle(by) {
    return Math.abs(this.share(this.raw) - 0.5) <= by;
  }

  share(raw) {
    return (raw - this.low) / (this.high - this.low);
  }
}

// A button counts after it has been seen released.
export class Button {
  constructor(isPressed) {
    this.isPressed = isPressed;
    this.reported = this.began = null;
    this.wasReleased = false;
  }

  report(isPressed, now) {
    this.wasReleased ||= !(this.isPressed && isPressed);
    [this.isPressed, this.reported] = [isPressed, now];
  }

  advance(now) {
    this.began ??= now;
    this.wasReleased ||= !this.isPressed;
  }

  value() {
    return Number(this.isPressed && this.wasReleased);
  }

  problem(now) {
    return this.began === null || now - this.began < PATIENCE_MS || this.wasReleased ? "" : t("has been held down from the start");
  }
}
