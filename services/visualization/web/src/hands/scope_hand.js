// The third hand on the page: it holds the laparoscope, by mouse, fingers or keys.

import { t } from "../school/i18n.js";
import { Keys } from "./keys.js";
import { Pointer } from "./pointer.js";

const $ = (id) => document.getElementById(id);
const TURN_PER_MM = 0.05, TURN_MS = 16;
const HOW = "Drag or arrows swing the scope about its port, wheel or W, S move it in and out, Q, E turn its lens.";
const WITH_FINGERS = "Drag to swing the scope about its port; a second finger up or down moves it in and out, sideways turns its lens.";

export class ScopeHand {
  // view: the `View` whose eye it moves; hands: the other two, which rest meanwhile
  constructor(view, hands) {
    this.view = view;
    this.hands = hands;
    this.pointer = new Pointer(view.canvas, {
      onDrag: (from, to) => this.drag(to.x - from.x, to.y - from.y),
      onLift: (mm, turns) => this.move((scope) => (turns ? scope.turn(mm * TURN_PER_MM) : scope.slide(mm))),
      onTurn: (rad) => this.move((scope) => scope.turn(rad)),
      onClick: () => {},
    });
    this.keys = new Keys({ Digit1: () => this.giveTo(0), Digit2: () => this.giveTo(1) });
    $("steer").onclick = () => this.hold(!this.scope);
    view.stage.onScope = () => this.show();
    addEventListener("keydown", (event) => this.pressed(event));
  }

  get scope() {
    return this.view.stage.scope;
  }

  pressed(event) {
    const typing = /^(INPUT|TEXTAREA|SELECT)$/.test(event.target?.tagName ?? "");
    if (event.code === "Digit3" && !typing && !event.repeat && !(event.ctrlKey || event.metaKey || event.altKey)) this.hold(!this.scope);
  }

  giveTo(which) {
    this.hold(false);
    this.hands?.choose(which);
  }

  hold(on) {
    if (on) this.view.stage.holdScope();
    else this.view.stage.dropScope();
    this.view.ask();
  }

  // Whoever took the scope or let go of it, such as a button of the camera: called by the stage.
  show() {
    const on = Boolean(this.scope);
    this.pointer.on = this.keys.on = on;
    this.hands?.rest(on);
    $("steer").setAttribute("aria-pressed", on);
    $("scope-hint").hidden = !on;
    $("scope-hint").textContent = t(matchMedia("(pointer: coarse)").matches ? WITH_FINGERS : HOW);
    clearInterval(this.timer);
    this.last = performance.now();
    if (on) this.timer = setInterval(() => this.turn(), TURN_MS);
  }

  move(change) {
    if (!this.scope) return;
    change(this.scope);
    this.view.stage.placeScope();
    this.view.ask();
  }

  // Pixels; what is looked at stays under the pointer, as the eye moves and turns about the port at once.
  drag(x, y) {
    const { stage } = this.view;
    const rad = stage.mmPerPixel() / (this.scope.depth + stage.lookDistance()), mirror = stage.mirrored ? -1 : 1;
    this.move((scope) => scope.swing(-mirror * x * rad, y * rad));
  }

  // Sixty times a second: keys.
  turn() {
    const now = performance.now(), seconds = Math.min(0.1, (now - this.last) / 1000);
    this.last = now;
    const [right, up, further, turn] = this.keys.take(seconds), mirror = this.view.stage.mirrored ? -1 : 1;
    if (!(right || up || further || turn)) return;
    this.move((scope) => {
      scope.swing((mirror * right) / scope.depth, up / scope.depth);
      if (further) scope.slide(further);
      scope.turn(mirror * turn);
    });
  }
}
