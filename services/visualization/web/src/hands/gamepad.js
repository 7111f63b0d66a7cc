// A gamepad as two hands: sticks move, shoulder buttons raise, pressed sticks lower, the cross and the buttons opposite
// turn, triggers close the jaws; it rumbles with force. Nothing counts before it was seen at rest (axis.js).

import { t } from "../school/i18n.js";
import { Axis, Button, DEAD } from "./axis.js";

const MM_PER_S = 25, RAD_PER_S = 1.2, RUMBLE_MS = 120;
const HANDS = [
  { x: 0, y: 1, up: 4, down: 10, turn: [14, 15], close: 6 }, // left: stick, shoulder, the stick pressed, cross, trigger
  { x: 2, y: 3, up: 5, down: 11, turn: [2, 1], close: 7 },
];
const STICKS = ["left stick, sideways", "left stick, up and down", "right stick, sideways", "right stick, up and down"];
const TRIGGERS = HANDS.map((hand) => hand.close);

const live = (x) => (Math.abs(x) < DEAD ? 0 : (x - Math.sign(x) * DEAD) / (1 - DEAD));
const isDown = (button) => (button?.value ?? 0) > 0.5;

// One pad of the standard layout, and what was learned of it since it came.
class Pad {
  constructor(pad) {
    this.id = pad.id ?? "";
    this.axes = STICKS.map((_, i) => new Axis(-1, 1, pad.axes[i] ?? 0));
    this.buttons = pad.buttons.map((button, i) => (TRIGGERS.includes(i) ? new Axis(0, 1, button.value) : new Button(isDown(button))));
  }

  look(pad, now) {
    this.axes.forEach((axis, i) => (pad.axes[i] ?? 0) !== axis.raw && axis.report(pad.axes[i] ?? 0, now));
    this.buttons.forEach((button, i) => {
      const is = TRIGGERS.includes(i) ? (pad.buttons[i]?.value ?? 0) : isDown(pad.buttons[i]);
      if (is !== (TRIGGERS.includes(i) ? button.raw : button.isPressed)) button.report(is, now);
    });
    for (const each of [...this.axes, ...this.buttons]) each.advance(now);
  }

  hands(seconds) {
    const pressed = (i) => this.buttons[i]?.value() ?? 0;
    return HANDS.map((hand) => ({
      by: [live(this.axes[hand.x].stick()), -live(this.axes[hand.y].stick()), pressed(hand.up) - pressed(hand.down)].map((x) => x * MM_PER_S * seconds),
      roll: (pressed(hand.turn[1]) - pressed(hand.turn[0])) * RAD_PER_S * seconds,
      closing: this.buttons[hand.close]?.trigger() ?? 0,
    }));
  }

  // What of it does not count, and why.
  problems(now) {
    const found = this.axes.map((axis, i) => [t(STICKS[i]), axis.problem(now) || (axis.end !== null && axis.middle === null ? t("rests at an end") : "")]);
    found.push(...this.buttons.map((button, i) => [TRIGGERS.includes(i) ? t("a trigger") : t("button {i}", { i }), button.problem(now)]));
    const told = found.filter(([, why]) => why).map(([what, why]) => `${what} ${why}`);
    return told.length ? [t("“{pad}” is not used in part: {told}: let go of it.", { pad: this.id, told: told.join(", ") })] : [];
  }
}

export class Gamepads {
  constructor() {
    this.pad = this.index = null;
    this.ignored = []; // sentences: which pad, or what of it, is not used, and why
  }

  // The command of the first pad with a known layout to each hand over `seconds`: right, away and up in mm, roll in rad,
  // and closing; null without such a pad.
  read(seconds, now, pads = navigator.getGamepads?.() ?? []) {
    const all = [...pads].filter((each) => each?.connected), used = all.find((each) => each.mapping === "standard");
    this.ignored = all.filter((each) => each !== used).map((each) => (each.mapping === "standard"
      ? t("“{pad}” is not used: one pad moves both hands, and “{other}” does.", { pad: each.id, other: used.id })
      : t("“{pad}” is not used: this browser does not know its layout, so its axes have no meaning. The rig file “gamepad” reads it.", { pad: each.id })));
    if (!used) return (this.pad = null);
    if (this.pad?.id !== (used.id ?? "") || this.index !== used.index) [this.pad, this.index] = [new Pad(used), used.index];
    this.pad.look(used, now);
    this.ignored.push(...this.pad.problems(now));
    return this.pad.hands(seconds);
  }
}

export function rumble(newton, fullNewton, pads = navigator.getGamepads?.() ?? []) {
  const strength = Math.min(1, newton / fullNewton);
  if (strength < 0.02) return;
  for (const pad of pads) {
    pad?.vibrationActuator?.playEffect?.("dual-rumble", { duration: RUMBLE_MS, weakMagnitude: strength, strongMagnitude: strength ** 2 });
  }
}
