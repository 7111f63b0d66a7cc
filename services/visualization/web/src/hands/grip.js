// One hand of a person: the position, roll and opening that it commands to the jaws, or the tip, of its tool.

import { t } from "../school/i18n.js";
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
    if (fingers && this.hasJaws) return t("Drag to move the jaws, a second finger up or down to lift, tap to close them; the button is for the other hand.");
    if (fingers) return t("Drag to move the tip, a second finger up or down to lift it; the button is for the other hand.");
    if (this.hasJaws) return t("Drag or arrows move the jaws, wheel or W, S lift, click or Space closes them; Tab is for the other hand.");
    return t("Drag or arrows move the tip, wheel or W, S lift it; Tab is for the other hand.");
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
