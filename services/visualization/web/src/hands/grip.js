// One hand of a person: the position, roll and opening that it commands to the jaws, or the tip, of its tool.

import { add, atDepth, jawsAt, junctionAt, leashed, length, sub } from "./motion.js";

const MM = 1000;
const LEASH_MM = 25;
const SEEN = 0.65; // of the jaws' length, where they are said to be

export class Grip {
  // tool: of the greeting, in SI units; shape: of the layout, in millimetres.
  constructor(tool, shape) {
    this.name = tool.name;
    this.port = shape.port;
    this.hasJaws = shape.jawLength > 0;
    this.reach = SEEN * shape.jawLength;
    this.jaws = jawsAt(tool.position_m.map((x) => x * MM), this.port, this.reach);
    this.roll = tool.roll_rad;
    this.opening = null; // as it was found
    this.depth = null; // held, from the port
  }

  // How a person moves the tool, with a mouse or with fingers.
  hint(fingers) {
    const [drag, lift, click, other] = fingers
      ? ["Drag to move", "a second finger up or down to lift", "tap to close", "the button is for the other hand"]
      : ["Drag or arrows move", "wheel or W, S lift", "click or Space closes", "Tab is for the other hand"];
    return this.hasJaws ? `${drag} the jaws, ${lift}, ${click} them; ${other}.` : `${drag} the tip, ${lift} it; ${other}.`;
  }

  // Moves the jaws by (3,) millimetres; returns by how much they moved.
  move(by, toolAt) {
    const before = this.jaws;
    let wanted = add(before, by);
    if (this.depth !== null) wanted = atDepth(wanted, this.port, this.depth);
    this.jaws = toolAt ? leashed(wanted, toolAt, LEASH_MM) : wanted;
    return sub(this.jaws, before);
  }

  turn(by) {
    this.roll = Math.min(Math.max(this.roll + by, -Math.PI), Math.PI);
  }

  holdDepth(on) {
    this.depth = on ? length(sub(this.jaws, this.port)) : null;
  }

  // Where the jaws are of the tool as it was drawn last. pose: J and quaternion, in millimetres.
  jawsOf(pose) {
    return jawsAt([...pose.subarray(0, 3)], this.port, this.reach);
  }

  // Both ends of the jaws.
  ends() {
    const junction = junctionAt(this.jaws, this.port, this.reach);
    return [junction, jawsAt(junction, this.port, this.reach / SEEN)];
  }

  // The row of the wire's `visualization.hands`.
  row() {
    const junction = junctionAt(this.jaws, this.port, this.reach).map((x) => x / MM);
    return [this.name, junction, this.roll, this.opening ?? -1];
  }
}
