// Mouse and touch as a hand: a drag moves the jaws level, the wheel or a second finger raises and lowers, a click
// opens or closes. A second finger that sets off sideways turns the tool instead. What the person has taken hold of stays
// under the pointer.

const CLICK_PX = 5, WHEEL_MM = 1 / 60, FINGER_MM = 0.15, FINGER_RAD = 0.012;

export class Pointer {
  // handlers: onDrag(from, to) in pixels of the page, onLift(mm, withRoll), onTurn(rad), onClick()
  constructor(canvas, handlers) {
    this.handlers = handlers;
    this.down = new Map();
    this.on = false;
    canvas.addEventListener("pointerdown", (event) => this.start(event, canvas));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    for (const kind of ["pointerup", "pointercancel"]) canvas.addEventListener(kind, (event) => this.end(event));
    canvas.addEventListener("wheel", (event) => this.wheel(event), { capture: true, passive: false });
  }

  start(event, canvas) {
    if (!this.on || event.button !== 0) return;
    canvas.setPointerCapture(event.pointerId);
    const [x, y] = [event.clientX, event.clientY];
    this.down.set(event.pointerId, { x, y, began: [x, y], far: 0, alone: true });
    if (this.down.size === 1) return;
    for (const each of this.down.values()) Object.assign(each, { began: [each.x, each.y], far: 0, alone: false });
    this.way = null; // of two fingers: what their first step says
  }

  move(event) {
    const from = this.down.get(event.pointerId);
    if (!from) return;
    const to = { x: event.clientX, y: event.clientY };
    from.far += Math.hypot(to.x - from.x, to.y - from.y);
    if (this.down.size > 1) this.withTwo(from, to);
    else if (from.far > CLICK_PX) this.handlers.onDrag(from, to);
    [from.x, from.y] = [to.x, to.y];
  }

  withTwo(from, to) {
    const [x, y] = [to.x - from.began[0], to.y - from.began[1]].map(Math.abs);
    if (from.far > CLICK_PX) this.way ??= x > y ? "turn" : "lift";
    if (this.way === "turn") this.handlers.onTurn((to.x - from.x) * FINGER_RAD);
    if (this.way === "lift") this.handlers.onLift((from.y - to.y) * FINGER_MM, false);
  }

  end(event) {
    const from = this.down.get(event.pointerId);
    this.down.delete(event.pointerId);
    if (from && event.type === "pointerup" && from.far <= CLICK_PX && from.alone) this.handlers.onClick();
  }

  wheel(event) {
    if (!this.on || event.ctrlKey) return; // with Ctrl it brings the eye closer, as ever
    event.preventDefault();
    event.stopImmediatePropagation();
    this.handlers.onLift(-(event.deltaY || event.deltaX) * WHEEL_MM, event.shiftKey);
  }
}
