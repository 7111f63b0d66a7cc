// Two controllers as two hands: pressed grips hold the world, else each moves the instrument of its side; triggers close jaws.

import { carried, stretched, turnAlong, wayToWorld } from "./placement.js";
import { sub } from "../hands/motion.js";

const PRESSED = 0.5;
const SIDES = ["left", "right"];

export class Controllers {
  constructor() {
    this.before = {}; // of each side: where it was in the last frame
  }

  // seen: of each side, where it is: position (3,) in m, turn (4,), trigger and squeeze from 0 to 1; a side that is not seen is not in it.
  // Returns the place after that, and what each instrument is to do: by (3,) in mm of the world, roll in rad, closing.
  take(seen, place) {
    const both = SIDES.filter((side) => seen[side] && this.before[side]);
    const holding = both.filter((side) => seen[side].squeeze > PRESSED && this.before[side].squeeze > PRESSED);
    const paths = holding.map((side) => [this.before[side].position, seen[side].position]);
    const next = paths.length === 2 ? stretched(place, paths) : paths.length === 1 ? carried(place, ...paths[0]) : place;
    const moves = {};
    for (const side of both) {
      if (seen[side].squeeze > PRESSED || this.before[side].squeeze > PRESSED) continue;
      const { position, turn } = this.before[side];
      moves[side] = {
        by: wayToWorld(place, sub(seen[side].position, position)), roll: turnAlong(turn, seen[side].turn), closing: seen[side].trigger,
      };
    }
    this.before = seen;
    return { place: next, moves };
  }
}

// What a frame of WebXR tells of the controllers in a reference space.
export function look(frame, space, sources) {
  const seen = {};
  for (const source of sources) {
    const pose = source.gripSpace && SIDES.includes(source.handedness) ? frame.getPose(source.gripSpace, space) : null;
    if (!pose || pose.emulatedPosition) continue; // it is guessed where it is
    const { position: p, orientation: q } = pose.transform, buttons = source.gamepad?.buttons ?? [];
    seen[source.handedness] = {
      position: [p.x, p.y, p.z], turn: [q.x, q.y, q.z, q.w], trigger: buttons[0]?.value ?? 0, squeeze: buttons[1]?.value ?? 0,
    };
  }
  return seen;
}
