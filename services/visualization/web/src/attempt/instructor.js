// The instructor's face: live phase and errors, the attempts so far, and the controls that need the token.

import { element, Rows, text } from "../dashboard/rows.js";
import { said, t } from "../school/i18n.js";
import { clock, errorList, headline, mm, notCounted, PHASES, scoreWords } from "./words.js";

const $ = (id) => document.getElementById(id);
const KEPT = 100;

export class Instructor {
  constructor(orders) {
    this.orders = orders;
    this.attempts = new Map();
    this.phases = Object.values(PHASES).map((words) => element("li", { textContent: t(words) }));
    $("phases").append(...this.phases);
    this.errors = new Rows($("attempt-errors"), () => element("li"), (row, { words, count }) => text(row, counted(words, count)));
    this.rows = new Rows($("attempts"), () => element("tr", {}, ...Array.from({ length: 5 }, () => element("td"))), showAttempt);
    this.buttons = [...document.querySelectorAll("#instructor [data-order]")];
    for (const button of this.buttons) button.onclick = () => orders.ask(button.dataset.order, Number(button.dataset.value ?? 0));
    $("pause").onclick = () => orders.ask(this.attempt?.pace === 1 ? "pause" : "resume");
    $("slow").onchange = () => orders.ask("slow", Number($("slow").value));
    $("instructor-mirror").onclick = () => $("mirror").click();
    $("scenario-run").onclick = () => orders.post("api/scenario", $("scenario").value);
  }

  admit(token) {
    this.admitted = Boolean(token);
    for (const control of [...this.buttons, $("pause"), $("slow")]) control.disabled = !token;
    this.admitSwitch();
    $("instructor-said").textContent = token ? "" : t("To command the attempt, open the address that trocar up printed, with its #token=….");
  }

  say(words, ok) {
    text($("instructor-said"), words);
    $("instructor-said").dataset.level = ok ? "good" : "bad";
  }

  // Every new link to the rig calls this too; the instructor's choice stays.
  setRig({ scenarios = [], scenario, switches }) {
    this.switches = switches;
    const chosen = $("scenario").value || scenario;
    $("scenario").replaceChildren(...scenarios.map((name) => element("option", { value: name, textContent: name, selected: name === chosen })));
    text($("scenario-how"), switches ? "" : t("This rig was not started by trocar up; trocar up --scenario NAME begins one."));
    this.admitSwitch();
  }

  admitSwitch() {
    for (const id of ["scenario", "scenario-run"]) $(id).disabled = !(this.admitted && this.switches);
  }

  update(attempt) {
    this.attempt = attempt;
    if (!attempt) return;
    const { mark, words, more } = headline(attempt);
    text($("instructor-state"), `${mark} ${words}${more ? `: ${more}` : ""}`);
    text($("instructor-figures"), `${clock(attempt.time_s)} · ${mm(attempt.depth_m)} · ${t("{n} bookmarks", { n: attempt.bookmarks_s.length })}${attempt.score >= 0 ? ` · ${scoreWords(attempt)}` : ""}`);
    text($("instructor-not"), notCounted(attempt));
    text($("instructor-scenario"), attempt.scenario ? `${attempt.scenario}: ${said(attempt.title)}` : said(attempt.title));
    for (const [i, code] of Object.keys(PHASES).entries()) this.phases[i].classList.toggle("now", code === attempt.phase);
    text($("phase-none"), attempt.phase || attempt.state === "armed" ? "" : t("Nobody judges phases in this rig."));
    this.errors.update(errorList(attempt.errors), ({ code }) => code);
    text($("errors-none"), Object.keys(attempt.errors).length ? "" : t("None so far."));
    text($("pause"), attempt.pace === 1 ? t("Pause") : t("Go on"));
    $("step").disabled = $("step-more").disabled = !this.orders.token || attempt.pace !== 0;
    if (document.activeElement !== $("slow") && attempt.pace > 0) $("slow").value = String(nearestPace(attempt.pace));
    this.remember(attempt);
  }

  // The attempts that this page has seen; the rig's own list is in its recordings.
  remember(attempt) {
    if (attempt.state === "armed") return;
    const kept = this.attempts.get(attempt.attempt_id) ?? { number: this.attempts.size + 1 };
    this.attempts.set(attempt.attempt_id, { ...kept, ...attempt });
    if (this.attempts.size > KEPT) this.attempts.delete(this.attempts.keys().next().value);
    for (const [id, each] of this.attempts) if (id !== attempt.attempt_id && each.state === "running") each.state = "abandoned";
    this.rows.update([...this.attempts.values()], ({ attempt_id: id }) => id);
  }
}

const counted = (words, count) => (count > 1 ? `${words} ×${count}` : words);

function nearestPace(pace) {
  return 1 / 2 ** Math.min(5, Math.max(0, Math.round(-Math.log2(pace))));
}

function showAttempt(row, { number, state, outcome, time_s: time, depth_m: depth, errors, counts }) {
  const wrong = errorList(errors), count = wrong.reduce((sum, each) => sum + each.count, 0);
  const cells = [number, `${t(outcome || state)}${counts ? "" : " *"}`, clock(time), mm(depth), count || "–"];
  cells.forEach((value, i) => text(row.children[i], String(value)));
  row.title = [counts ? "" : t("does not count"), ...wrong.map(({ words, count }) => counted(words, count))].filter(Boolean).join("; ");
}
