// A person's hands on the instruments: their inputs, their frames to the rig, and the force that the page shows.

import { said, t } from "../school/i18n.js";
import { Grip } from "./grip.js";
import { Gamepads, rumble } from "./gamepad.js";
import { Keys } from "./keys.js";
import { HandLink } from "./link.js";
import { onLevel, onPicture, scale, add, sub } from "./motion.js";
import { Pointer } from "./pointer.js";
import { Tone } from "./tone.js";

const $ = (id) => document.getElementById(id);
const FULL_N = 3;
const ROLL_PER_MM = 0.05;
const SHUT = 0, OPEN = 1;
const HOW = "Move the forceps yourself: take the catheter, and slide it into the duct.";
const NEEDS_TOKEN = "To take the instruments, open the address that trocar up printed.";

export class Hands {
  // view: the `View` whose stage the hands work in; token: the session's, or null
  constructor(view, token) {
    this.view = view;
    this.token = token;
    this.grips = [];
    this.active = 0;
    this.tone = new Tone();
    this.gamepads = new Gamepads();
    this.pointer = new Pointer(view.canvas, {
      onDrag: (from, to) => this.drag(from, to),
      onLift: (mm, roll) => this.lift(mm, roll),
      onTurn: (rad) => this.grip?.turn(rad),
      onClick: () => this.toggleJaws(),
    });
    this.keys = new Keys({
      Space: () => this.toggleJaws(), Tab: () => this.choose(this.active + 1),
      Digit1: () => this.choose(0), Digit2: () => this.choose(1),
    });
    this.bind();
  }

  bind() {
    $("take-hands").onclick = () => (this.link ? this.letGo("") : this.take());
    $("hand-which").onclick = () => this.choose(this.active + 1);
    $("hand-jaws").onclick = () => this.toggleJaws();
    this.switch("hand-depth", (on) => this.grips.forEach((grip) => grip.holdDepth(on)));
    this.switch("hand-follow", (on) => (this.following = on));
    this.switch("hand-tone", (on) => this.tone.switch(on));
  }

  switch(id, apply) {
    $(id).onclick = () => {
      const on = $(id).getAttribute("aria-pressed") !== "true";
      $(id).setAttribute("aria-pressed", on);
      apply(on);
    };
  }

  // Offers the hands where the rig has instruments that follow a page; they reach it where `stream` has its pictures from.
  offer(stream, followers) {
    this.stream = stream;
    $("hands").hidden = !followers.length;
    this.admit(this.token);
  }

  // Takes the session's token, or null: without it the instruments cannot be taken.
  admit(token) {
    this.token = token;
    if (this.link) return;
    $("take-hands").disabled = !token || !this.view.last; // while the rig starts there is nothing to take
    if (!this.view.last) setTimeout(() => this.link || this.admit(this.token), 500);
    $("hand-hint").textContent = t(token ? HOW : NEEDS_TOKEN);
  }

  take() {
    this.link = new HandLink(this.stream.address, this.token, {
      onGreeting: (greeting) => this.begin(greeting),
      onEnd: (reason) => this.letGo(reason),
    });
  }

  // Called again when the scene restarts: the tools are back at their start.
  begin(greeting) {
    const again = this.grips.length > 0, which = this.active;
    this.begins = greeting.begins;
    clearInterval(this.timer);
    const shapes = this.view.stage.layout?.tools ?? [];
    const pairs = greeting.tools.map((tool) => [tool, shapes.findIndex((shape) => shape.name === tool.name)]);
    this.grips = pairs.filter(([, at]) => at >= 0).map(([tool, at]) => Object.assign(new Grip(tool, shapes[at]), { at }));
    if (!this.grips.length) return this.letGo("The instruments have not been heard of yet: try again.");
    this.timer = setInterval(() => this.turn(), 1000 / greeting.rate_hz);
    this.last = performance.now();
    this.show(true);
    this.choose(again ? which : 0);
    if (again) return;
    this.view.stage.lookOver(this.grips.flatMap((grip) => grip.ends()));
  }

  letGo(reason) {
    clearInterval(this.timer);
    this.link?.close();
    this.link = null;
    this.grips = [];
    this.tone.sound(0);
    this.show(false);
    if (reason) $("hand-hint").textContent = said(reason);
  }

  // While the third hand holds the scope, mouse and keys are its own.
  rest(on) {
    this.rests = on;
    this.pointer.on = this.keys.on = Boolean(this.link) && !on;
  }

  show(on) {
    this.pointer.on = this.keys.on = on && !this.rests;
    this.view.stage.giveLeftButton(on);
    $("hands").classList.toggle("taken", on);
    $("take-hands").textContent = t(on ? "Let go" : "Take the instruments");
    if (!on) this.admit(this.token);
  }

  get grip() {
    return this.grips[this.active];
  }

  choose(which) {
    this.active = which % Math.max(1, this.grips.length);
    if (!this.grip) return;
    $("hand-which").textContent = t("Hand: {name}", { name: t(this.grip.name) });
    $("hand-hint").textContent = this.grip.hint(matchMedia("(pointer: coarse)").matches);
    this.showJaws();
    [...$("tools").children].forEach((row, i) => row.classList.toggle("active", i === this.grip.at));
  }

  showJaws() {
    $("hand-jaws").hidden = !this.grip.hasJaws;
    $("hand-jaws").textContent = t(this.grip.opening === SHUT ? "Open jaws" : "Close jaws");
  }

  toggleJaws() {
    if (!this.grip?.hasJaws) return;
    this.grip.opening = this.grip.opening === SHUT ? OPEN : SHUT;
    this.showJaws();
  }

  // Pixels from and to; what is under the pointer stays there.
  drag(from, to) {
    const grip = this.grip, stage = this.view.stage;
    if (!grip) return;
    const rays = [from, to].map((point) => stage.rayAt(point.x, point.y));
    let points = rays.map((ray) => onLevel(ray, grip.jaws[2]));
    if (points.includes(null)) points = rays.map((ray) => onPicture(ray, grip.jaws, stage.forward()));
    this.move(grip, sub(points[1], points[0]));
  }

  lift(mm, roll) {
    if (!this.grip) return;
    if (roll) this.grip.turn(mm * ROLL_PER_MM);
    else this.move(this.grip, [0, 0, mm]);
  }

  move(grip, by) {
    const frame = this.view.last;
    const toolAt = (each) => frame && each.jawsOf(frame.poses.subarray(7 * each.at, 7 * each.at + 7));
    const moved = grip.move(by, toolAt(grip));
    if (!this.following) return;
    for (const other of this.grips) if (other !== grip) other.move(moved, toolAt(other));
  }

  // Sixty times a second: keys, gamepad, frames to the rig, the tone.
  turn() {
    const now = performance.now(), seconds = Math.min(0.1, (now - this.last) / 1000);
    this.last = now;
    const { right, away } = this.view.stage.levelAxes();
    const inWorld = (by) => add(add(scale(right, by[0]), scale(away, by[1])), [0, 0, by[2]]);
    const [x, y, z, roll] = this.keys.take(seconds);
    if (x || y || z) this.move(this.grip, inWorld([x, y, z]));
    if (roll) this.grip.turn(roll);
    this.gamepads.read(seconds, now)?.forEach((hand, i) => this.follow(this.grips[i], hand, inWorld));
    this.tellOfPads();
    this.link?.send(this.grips, this.begins, Math.round(10 * (this.view.painted ?? -1)) / 10);
    this.feel();
  }

  // Which gamepad, or what of it, is not used, and why.
  tellOfPads() {
    const text = this.gamepads.ignored.join(" ");
    if (text === this.told) return;
    this.told = text;
    $("hand-pads").textContent = text;
    $("hand-pads").hidden = !text;
  }

  follow(grip, hand, inWorld) {
    if (!grip) return;
    if (hand.by.some((x) => x)) this.move(grip, inWorld(hand.by));
    if (hand.roll) grip.turn(hand.roll);
    if (hand.closing > 0 || grip.trigger > 0) grip.opening = OPEN + (SHUT - OPEN) * hand.closing;
    grip.trigger = hand.closing;
  }

  feel() {
    const frame = this.view.last;
    if (!frame) return;
    const newton = Math.max(0, ...this.grips.map((grip) => Math.hypot(...frame.forces.subarray(3 * grip.at, 3 * grip.at + 3))));
    this.tone.sound(newton);
    rumble(newton, FULL_N);
  }
}
