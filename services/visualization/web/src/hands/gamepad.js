// A gamepad as two hands: sticks move, shoulder buttons raise, pressed sticks lower, the cross and the buttons opposite
// turn, triggers close the jaws; it rumbles with force.

const DEAD = 0.12, MM_PER_S = 25, RAD_PER_S = 1.2, RUMBLE_MS = 120;
const HANDS = [
  { x: 0, y: 1, up: 4, down: 10, turn: [14, 15], close: 6 }, // left: stick, shoulder, the stick pressed, cross, trigger
  { x: 2, y: 3, up: 5, down: 11, turn: [2, 1], close: 7 },
];

const live = (x) => (Math.abs(x) < DEAD ? 0 : (x - Math.sign(x) * DEAD) / (1 - DEAD));

// The first gamepad's command to each hand over `seconds`: right, away and up in mm, roll in rad, and closing.
export function readGamepad(seconds, pads = navigator.getGamepads?.() ?? []) {
  const pad = [...pads].find((each) => each?.connected && each.mapping === "standard");
  if (!pad) return null;
  const pressed = (i) => pad.buttons[i]?.value ?? 0;
  return HANDS.map((hand) => ({
    by: [live(pad.axes[hand.x]), -live(pad.axes[hand.y]), pressed(hand.up) - pressed(hand.down)].map((x) => x * MM_PER_S * seconds),
    roll: (pressed(hand.turn[1]) - pressed(hand.turn[0])) * RAD_PER_S * seconds,
    closing: pressed(hand.close),
  }));
}

export function rumble(newton, fullNewton, pads = navigator.getGamepads?.() ?? []) {
  const strength = Math.min(1, newton / fullNewton);
  if (strength < 0.02) return;
  for (const pad of pads) {
    pad?.vibrationActuator?.playEffect?.("dual-rumble", { duration: RUMBLE_MS, weakMagnitude: strength, strongMagnitude: strength ** 2 });
  }
}
