// How finely this computer draws, so that it holds its pictures a second. Pure: no page, no clock. When a step is given up and when
// it is taken back is quality_governor.js's; what is too slow, and whether a finer step would fit, is known here.
import { t } from "../school/i18n.js";
import { QualityGovernor } from "./quality_governor.js";

// From the finest to the coarsest: pixels of a picture per pixel of the page, look of the bodies (wet: light for each pixel, relief;
// plain: light for each pixel; coarse: fewer triangles, light for each vertex), shadows, pictures asked for a second (none: all
// that the rig makes). With a graphics processor, materials and pixels go first.
const HARDWARE = [
  { ratio: 2, look: "wet", shadows: true }, { ratio: 1, look: "wet", shadows: true }, { ratio: 1, look: "wet" },
  { ratio: 1, look: "plain" }, { ratio: 0.75, look: "plain" }, { ratio: 0.5, look: "plain" }, { ratio: 0.5, look: "plain", hz: 20 },
  { ratio: 0.35, look: "coarse", hz: 15 },
];
// On the processor every triangle, pixel and picture is taken from somebody, who may be a loop of the rig on the same core. At least
// twelve pictures a second are to be seen, or an attempt does not count. So more are asked for, as some are late: of 15, 9 to 12 were
// seen in an attempt; of 20, at least 12.
const SOFTWARE = [
  { ratio: 1, look: "plain", hz: 20 }, { ratio: 0.75, look: "plain", hz: 20 }, { ratio: 1, look: "coarse", hz: 20 },
  { ratio: 0.75, look: "coarse", hz: 20 }, { ratio: 0.5, look: "coarse", hz: 20 }, { ratio: 0.35, look: "coarse", hz: 20 },
  { ratio: 0.25, look: "coarse", hz: 20 },
];
const SOFTWARE_BEGINS = 4;
const WEIGHT = { wet: 3, plain: 1, coarse: 0.08 }; // of a pixel: measured with SwiftShader, plain to coarse
const WORDS = { plain: "plain materials", coarse: "coarse shapes" };
const HARDWARE_HZ = 30; // to be held where all pictures are asked for
const SHARE = { hardware: 0.7, software: 0.55 }; // of the time between pictures that drawing one may take
const HELD = 0.85; // of the pictures that came or were asked for
const SLOW_LOOKS = 2; // one slow look is chance
const ROOM = 0.7; // of the share, as it would be one step finer
const HYSTERESIS = { calm_s: 6, trial_s: 20, longest_s: 120 };

export function ladder(software, devicePixelRatio) {
  const steps = (software ? SOFTWARE : HARDWARE).map((step) => ({ shadows: false, hz: null, ...step, ratio: Math.min(step.ratio, devicePixelRatio) }));
  return steps.filter((step, i) => i === 0 || JSON.stringify(step) !== JSON.stringify(steps[i - 1]));
}

export function weight({ ratio, look, shadows }) {
  return ratio * ratio * WEIGHT[look] * (shadows ? 1.5 : 1);
}

export class Governor extends QualityGovernor {
  constructor(steps, software) {
    const begins = software ? Math.min(SOFTWARE_BEGINS, steps.length - 1) : 0;
    super(steps.length, HYSTERESIS, Array.from({ length: begins + 1 }, (_, k) => k));
    this.steps = steps;
    this.share = software ? SHARE.software : SHARE.hardware;
    this.slow = 0;
  }

  get at() {
    return this.level;
  }

  // Sets a step as if the governor had come down to it step by step.
  set at(level) {
    this.way = Array.from({ length: level + 1 }, (_, k) => k);
  }

  get step() {
    return this.steps[this.at];
  }

  target(step = this.step) {
    return step.hz ?? HARDWARE_HZ;
  }

  // Pictures a second below which the step is not held, where so many came.
  least(offered) {
    return HELD * Math.min(this.target(), offered);
  }

  budget(step = this.step) {
    return (this.share * 1000) / this.target(step);
  }

  // What was seen lately: `now` in s, milliseconds of drawing one picture (null: not known), pictures a second that came and that
  // were painted. Returns whether the step has changed.
  look({ now, cost, offered, painted }) {
    if (painted < this.least(offered) || cost > this.budget()) {
      const isOver = ++this.slow >= SLOW_LOOKS;
      if (isOver) this.slow = 0;
      return this.observe(now, isOver ? "over" : "full");
    }
    this.slow = 0;
    // A finer step that would not fit is not tried: what flickers is worse than what is coarse.
    return this.calm(now) && this.fitsFiner(cost) && this.comeBack(now);
  }

  fitsFiner(cost) {
    if (this.at === 0 || cost === null) return false;
    const finer = this.steps[this.at - 1];
    return cost * (weight(finer) / weight(this.step)) < ROOM * this.budget(finer);
  }

  // The note on the picture; empty while everything is drawn at full quality.
  words(software) {
    const { ratio, look, shadows, hz } = this.step, parts = [];
    if (this.at === 0 && !software) return "";
    if (ratio < 1) parts.push(t("{share} % of the resolution", { share: Math.round(100 * ratio) }));
    if (WORDS[look]) parts.push(t(WORDS[look]));
    else if (!shadows) parts.push(t("no shadows"));
    if (hz) parts.push(t("{hz} pictures a second asked for", { hz }));
    const why = software ? t("This browser draws on the processor") : t("This computer draws slowly");
    return parts.length ? `${why}: ${parts.join(", ")}.` : "";
  }
}
