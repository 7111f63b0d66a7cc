// The words and figures about an attempt, in one place for all faces.

export const PHASES = {
  P0: "traction", P1: "opening", P2: "approach", P3: "engage", P4: "advance", P5: "secure", P6: "flush", P7: "release",
};

export const ERRORS = {
  E1: "excess traction", E2: "opening torn wider", E3: "tip misses the opening", E4: "wall perforated", E5: "pushed against resistance",
  E6: "too deep or too shallow", E7: "catheter slipped out", E8: "catheter crushed", E9: "crimped or loose", E10: "air or leak",
  E11: "wrong direction", E12: "out of view or collision", E13: "catheter dropped", E14: "counter-traction lost",
};

import { said, t } from "../school/i18n.js";
import { what } from "../school/sentences.js";

export function clock(seconds) {
  const whole = Math.floor(Math.max(seconds, 0) + 1e-6);
  return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")}`;
}

export const mm = (metres) => `${(1000 * metres).toFixed(1)} mm`;

// The state for a trainee: a word, and a mark that needs no colour.
export function headline({ state, outcome, pace, reason, counts }, isStopped = false) {
  if (outcome === "success") return { mark: "✓", words: t("Well done"), more: said(reason), kind: "success" };
  if (outcome === "failure") return { mark: "✗", words: t("Not yet"), more: reasonWords(reason), kind: "failure" };
  if (isStopped) return { mark: "■", words: t("Stopped: press Arm to go on"), more: "", kind: "paused" };
  if (pace === 0) return { mark: "❚❚", words: t("Paused"), more: "", kind: "paused" };
  const slow = pace < 1 ? t(" at {pace} of the clock", { pace: paceWords(pace) }) : "";
  if (state === "armed" && !counts) return { mark: "○", words: t("Not ready"), more: "", kind: "armed" }; // the hint says what to do
  if (state === "armed") return { mark: "○", words: `${t("Begin when you like")}${slow}`, more: "", kind: "armed" };
  return { mark: "●", words: `${t("Under way")}${slow}`, more: "", kind: "running" };
}

// Why an attempt has failed; what a code stands for instead of the code.
const reasonWords = (reason) => {
  const code = /^(E\d+) must not happen/.exec(reason)?.[1];
  return code ? what(code) : said(reason);
};

// The total score of a finished attempt, which a report explains; empty without one.
export const scoreWords = ({ score, time_limit_s: most }) => (score >= 0 ? t("Score {score} of at most {most}", { score: score.toFixed(0), most: most.toFixed(0) }) : "");

export function paceWords(pace) {
  const parts = Math.round(1 / pace);
  return Math.abs(parts * pace - 1) < 1e-6 ? (parts === 1 ? "1" : `1/${parts}`) : pace.toFixed(2);
}

// The reason why an attempt is not scored, without the figures that only engineers need.
export const notCounted = ({ counts, why_not: why }) => (counts ? "" : t("This attempt does not count: {why}.", { why: said(why) }));

export function holding(held) {
  return t({ catheter: "holding the catheter", duct: "holding the duct" }[held] ?? "holding nothing");
}

export function errorList(errors) {
  const codes = Object.keys(errors ?? {}).filter((code) => errors[code] > 0).sort((a, b) => a.slice(1) - b.slice(1));
  return codes.map((code) => ({ code, words: t(ERRORS[code] ?? "error"), count: errors[code] }));
}
