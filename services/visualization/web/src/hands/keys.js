// The keyboard as a hand: which way each key moves the tool, while it is down.

const MM_PER_S = 20, RAD_PER_S = 1.2, FINE = 0.25;

// Right, away and up as the person sees it; roll.
const KEYS = {
  ArrowRight: [1, 0, 0, 0], ArrowLeft: [-1, 0, 0, 0], ArrowUp: [0, 1, 0, 0], ArrowDown: [0, -1, 0, 0],
  PageUp: [0, 0, 1, 0], PageDown: [0, 0, -1, 0], KeyW: [0, 0, 1, 0], KeyS: [0, 0, -1, 0],
  KeyQ: [0, 0, 0, -1], KeyE: [0, 0, 0, 1],
};

export class Keys {
  // presses: what a key does once, by its code
  constructor(presses) {
    this.down = new Set();
    this.fine = false;
    addEventListener("keydown", (event) => this.pressed(event, presses));
    addEventListener("keyup", (event) => this.down.delete(event.code));
    addEventListener("blur", () => this.down.clear());
  }

  pressed(event, presses) {
    const typing = /^(INPUT|TEXTAREA|SELECT)$/.test(event.target?.tagName ?? "");
    if (!this.on || typing || event.ctrlKey || event.metaKey || event.altKey) return;
    this.fine = event.shiftKey;
    if (event.code in presses) {
      if (!event.repeat) presses[event.code]();
    } else if (event.code in KEYS) this.down.add(event.code);
    else return;
    event.preventDefault();
  }

  // Right, away, up in mm and roll in rad for `seconds`.
  take(seconds) {
    const sum = [0, 0, 0, 0];
    for (const code of this.down) KEYS[code].forEach((x, i) => (sum[i] += x));
    const pace = this.fine ? FINE : 1;
    return sum.map((x, i) => x * seconds * pace * (i < 3 ? MM_PER_S : RAD_PER_S));
  }
}
