// The felt test of one arm: each step counts once it is seen, and what only a hand can tell once it is answered.

import { t } from "../school/i18n.js";

const PRESSED_N = 0.2, FREE_N = 0.05;
const MOVED_MM = 20; // assumption: far more than a hand's tremor, and less than any arm's room

// Steps of an arm's test: `seen` says whether what is asked for is there now, `ask` what the person is asked then.
export function stepsFor(name) {
  const hand = t(name);
  let from = null, to = null, pressed = false;
  const spread = ({ place }) => {
    if (!place) return [0, 0, 0];
    from = (from ?? place).map((x, k) => Math.min(x, place[k]));
    to = (to ?? place).map((x, k) => Math.max(x, place[k]));
    return to.map((x, k) => x - from[k]);
  };
  return [
    { key: "calibrated", words: t("Calibrate {name} as its maker says: the rig takes its position as valid.", { name: hand }), seen: ({ calibrated, state }) => calibrated && (state === "running" || state === "degraded" || state === "safe_stop") },
    { key: "follows", words: t("Lead {name} {mm} mm to the side, up and to the front: the encoders change, and the picture follows.", { name: hand, mm: MOVED_MM }), seen: (now) => spread(now).every((mm) => mm >= MOVED_MM), ask: t("Did the picture go where your hand went?") },
    { key: "armed", words: t("Press “Arm”: the arm may push."), seen: ({ stopped, state }) => !stopped && state !== "failed" },
    { key: "force", words: t("Press {name} gently against the duct until {newton} N are read.", { name: hand, newton: PRESSED_N }), seen: ({ newton }) => newton >= PRESSED_N, ask: t("Did you feel the force, without buzzing?") },
    { key: "free", words: t("Draw back: the force is gone."), seen: ({ newton }) => newton < FREE_N },
    { key: "stop", words: t("Press against the duct again, and then “Safe stop”: the hand goes limp at once."), seen: ({ newton, stopped }) => (pressed ||= !stopped && newton >= PRESSED_N) && stopped, ask: t("Did the hand go limp at once?") },
  ];
}

// Goes through an arm's steps one after the other. `result` is null until the test has passed or failed.
export class Walk {
  constructor(name) {
    this.name = name;
    this.steps = stepsFor(name);
    this.done = 0;
    this.asks = false; // whether the present step was seen, and waits for the person's answer
    this.result = null;
  }

  // now: calibrated; place of the tool in mm, or null; newton on it; stopped; state of the rig.
  see(now) {
    const step = this.steps[this.done];
    if (this.result || this.asks || !step.seen(now)) return;
    if (step.ask) this.asks = true;
    else this.goOn();
  }

  answer(isYes) {
    if (!this.asks) return;
    this.asks = false;
    if (isYes) this.goOn();
    else this.result = { passed: false, step: this.steps[this.done].key };
  }

  goOn() {
    if (++this.done === this.steps.length) this.result = { passed: true, step: "" };
  }
}
