// The trainee's face: goal and depth with its markers, clock, force with its limit, held bodies, and the next task.

import { text } from "../dashboard/rows.js";
import { said, t } from "../school/i18n.js";
import { clock, headline, holding, mm, notCounted, scoreWords } from "./words.js";

const $ = (id) => document.getElementById(id);
const MOST_MM = 25, STEP_MM = 5, TOLD_SPEED = 0.05;

export class AttemptPanel {
  constructor(orders) {
    this.orders = orders;
    this.attempt = null;
    $("attempt-again").onclick = () => orders.ask("new");
  }

  admit(token) {
    $("attempt-again").disabled = !token;
    $("attempt-again").title = t(token ? "Put everything back to its start (B)" : "Open the address that trocar up printed, with its #token=….");
  }

  // The force (N) beyond which the page asks the hand for less; null if there is none.
  get limit() {
    return this.attempt?.force_limit_n || null;
  }

  update(attempt, isStopped = false) {
    this.attempt = attempt;
    $("attempt").hidden = !attempt;
    if (!attempt) return;
    const { mark, words, more, kind } = headline(attempt, isStopped);
    if ($("attempt").dataset.kind !== kind) $("attempt").dataset.kind = kind;
    text($("attempt-title"), said(attempt.title));
    text($("attempt-mark"), mark);
    text($("attempt-state"), more ? `${words}: ${more}` : words);
    text($("attempt-clock"), clock(attempt.time_s));
    text($("attempt-limit"), attempt.time_limit_s ? t("of {time}", { time: clock(attempt.time_limit_s) }) : "");
    text($("attempt-score"), scoreWords(attempt));
    text($("attempt-hint"), said(attempt.hint));
    text($("attempt-not"), notCounted(attempt));
    this.showFitness(attempt);
    this.showDepth(attempt);
  }

  // Before an attempt: whether one can count on this machine. While it runs: how slow the clock goes.
  showFitness({ state, counts, practice_only: only = "", simulated_time: simulated, speed = 1 }) {
    const waits = state === "armed", isSlow = simulated && Math.abs(1 - speed) > TOLD_SPEED;
    $("attempt-fit").hidden = !(waits && counts) && !isSlow;
    $("attempt-fit").dataset.level = only || isSlow ? "warn" : "good";
    const fit = only ? t("Practise only, because {why}.", { why: said(only) }) : t("This machine can train: an attempt counts.");
    const pace = isSlow ? t("The clock goes at {percent} % of real time, so that nothing is lost.", { percent: Math.round(100 * speed) }) : "";
    text($("attempt-fit"), [waits && counts ? fit : "", pace].filter(Boolean).join(" "));
  }

  showDepth({ depth_m: depth, goal_depth_m: goal, depth_max_m: most }) {
    const end = Math.max(MOST_MM, 1250 * (most || goal || 0));
    const marks = `${goal} ${most} ${end}`;
    if (marks !== this.marks) this.drawScale(1000 * goal, 1000 * most, end);
    this.marks = marks;
    $("depth-bar").style.transform = `scaleX(${Math.min(1, Math.max(0, (1000 * depth) / end))})`;
    $("depth").dataset.reached = goal && depth >= goal ? (most && depth > most ? "beyond" : "yes") : "no";
    text($("depth-value"), mm(depth));
    $("depth").setAttribute("aria-valuenow", (1000 * depth).toFixed(1));
    $("depth").setAttribute("aria-valuetext", goal ? t("{depth} of {goal}", { depth: mm(depth), goal: mm(goal) }) : mm(depth));
  }

  drawScale(goal, most, end) {
    $("depth").setAttribute("aria-valuemax", end);
    const ticks = [];
    for (let at = STEP_MM; at < end; at += STEP_MM) ticks.push({ at, kind: "tick", words: "" });
    if (goal) ticks.push({ at: goal, kind: "goal", words: t("goal {mm}", { mm: goal.toFixed(0) }) });
    if (most) ticks.push({ at: most, kind: "most", words: t("max {mm}", { mm: most.toFixed(0) }) });
    $("depth-marks").replaceChildren(...ticks.map(({ at, kind, words }) => {
      const mark = Object.assign(document.createElement("span"), { className: at > 0.6 * end && words ? `${kind} far` : kind, textContent: words });
      mark.style.left = `${(100 * at) / end}%`;
      return mark;
    }));
  }

  // What hand `i` holds, in words.
  held(i) {
    return this.attempt?.held?.length > i ? holding(this.attempt.held[i]) : "";
  }
}
