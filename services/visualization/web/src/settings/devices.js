// Devices: what the host says of them, and a felt test of each arm, whose result goes into the journal of acts.

import { element, text } from "../dashboard/rows.js";
import { locale, said, t } from "../school/i18n.js";
import { Walk } from "./felt.js";

const MARKS = { ok: "✓", warn: "!", fail: "✗" };
const SHOWN_EVENTS = 6, PICTURE = [320, 200];

export class Devices {
  // school: who asks the host; view(): as it is now, which knows the forces
  constructor(school, view) {
    Object.assign(this, { school, view });
    this.walk = null;
    this.last = {}; // by arm, its newest test in the journal
  }

  async show({ instruments, is_running: runs }) {
    if (runs) this.last = await this.school.ask("settings/felt");
    this.found = element("div", {});
    this.list = element("ol", { className: "steps" });
    this.read = element("p", { className: "figure", role: "status" });
    this.events = element("ul", { className: "errors-of-rig" });
    this.instruments = instruments;
    const rows = instruments.map(({ name, driver, device, grasp }) => element("tr", {}, ...[t(name), driver, device || "–", grasp || "–"].map((words) => element("td", { textContent: words }))));
    const head = element("tr", {}, ...["Hand", "Driver", "Device file", "Handle"].map((words) => element("th", { textContent: t(words) })));
    const ask = element("button", { id: "devices-check", className: "action", textContent: t("Ask this host"), onclick: () => this.check(ask) });
    const host = element("section", {}, element("h2", { textContent: t("Instruments of this rig") }), element("div", { className: "scroll", tabIndex: 0 }, element("table", { className: "plain" }, element("thead", {}, head), element("tbody", {}, ...rows))), element("div", { className: "controls" }, ask), this.found);
    if (!runs) return [host];
    this.arms = element("ul", { className: "felt-arms" });
    this.asked = element("div", { className: "felt-asked", role: "group" });
    this.picture = element("canvas", { className: "felt-picture", width: PICTURE[0], height: PICTURE[1], hidden: true }); // the sheet lies over the large one
    this.picture.setAttribute("aria-label", t("The picture, small"));
    this.picture.setAttribute("role", "img");
    this.drawArms();
    return [
      host,
      element("section", {}, element("h2", { textContent: t("Felt test") }), element("p", { className: "small", textContent: t("One hand at the arm, the other at Safe stop (Escape). Each arm is tested by itself, and its result kept in the journal.") }), this.arms, element("div", { className: "felt" }, element("div", {}, this.list, this.read, this.asked), this.picture)),
      element("section", {}, element("h2", { textContent: t("What the rig says of its devices") }), this.events),
    ];
  }

  begin(name) {
    this.walk = new Walk(name);
    this.draw();
  }

  draw() {
    this.drawArms();
    this.drawSteps();
    this.drawQuestion();
  }

  // Each arm with what its newest test came to, and a button that begins one.
  drawArms() {
    this.arms.replaceChildren(...this.instruments.map(({ name }) => {
      const last = this.last[name], runs = this.walk?.name === name && !this.walk.result;
      const begin = element("button", { textContent: t("Test {name}", { name: t(name) }), onclick: () => this.begin(name) });
      begin.dataset.arm = name;
      const row = element("li", {}, begin, element("span", { textContent: runs ? t("The test goes on.") : toldOf(last) }));
      row.dataset.result = runs ? "runs" : last ? (last.passed ? "passed" : "failed") : "none";
      return row;
    }));
  }

  drawSteps() {
    const { steps, done, result } = this.walk;
    this.list.replaceChildren(...steps.map(({ words }, i) => {
      const state = i < done ? "done" : i > done ? "later" : result ? "failed" : "now", step = element("li", { textContent: words });
      step.dataset.state = state;
      if (state === "now") step.setAttribute("aria-current", "step");
      return step;
    }));
  }

  drawQuestion() {
    const { steps, done, asks } = this.walk;
    if (!asks) return this.asked.replaceChildren();
    const reply = (id, words, isYes) => element("button", { id, className: "action", textContent: words, onclick: () => this.answer(isYes) });
    this.asked.replaceChildren(element("p", { role: "alert", textContent: steps[done].ask }), element("div", { className: "controls" }, reply("felt-yes", t("Yes"), true), reply("felt-no", t("No"), false)));
  }

  async answer(isYes) {
    const walk = this.walk;
    walk.answer(isYes);
    this.draw();
    if (!walk.result) return;
    try {
      this.last = await this.school.post("settings/felt", { name: walk.name, value: walk.result.passed, key: walk.result.step });
    } catch (error) {
      this.asked.replaceChildren(element("p", { role: "alert", textContent: said(error.message) }));
    }
    this.drawArms();
  }

  update({ state, safe_stop: stopped, events = [], processes = [] }) {
    if (!this.arms?.isConnected) return;
    this.tell(events);
    if (!this.walk || this.walk.result) return;
    const { name, done, asks } = this.walk, i = this.instruments.findIndex((each) => each.name === name);
    const newton = this.view()?.felt[i] ?? 0, { gauges = {} } = processes.find((each) => each.name === "gateway") ?? {};
    const calibrated = gauges[`arm_calibrated.${name}`] === 1;
    this.walk.see({ state, stopped: Boolean(stopped) || state === "safe_stop", newton, calibrated, place: this.view()?.placeOf(i) ?? null });
    if (this.walk.done !== done || this.walk.asks !== asks) this.draw();
    this.showPicture();
    text(this.read, `${t(name)}: ${newton.toFixed(2)} N`);
  }

  showPicture() {
    const view = this.view();
    this.picture.hidden = !view?.stage?.layout;
    if (this.picture.hidden) return;
    view.stage.draw();
    this.picture.getContext("2d").drawImage(view.canvas, 0, 0, ...PICTURE);
  }

  tell(events) {
    const ours = events.filter(({ text: words }) => /gateway|arm|device|calibrat/i.test(words)).slice(-SHOWN_EVENTS).map(({ text: words }) => words);
    if (ours.join() === this.told) return;
    this.told = ours.join();
    this.events.replaceChildren(...(ours.length ? ours.map(said) : [t("Nothing.")]).map((words) => element("li", { textContent: words })));
  }

  async check(button) {
    button.disabled = true;
    this.found.replaceChildren(element("p", { className: "small", role: "status", textContent: t("The host is asked; that takes some seconds.") }));
    try {
      const checks = await this.school.ask("settings/devices");
      this.found.replaceChildren(element("ul", { className: "checks" }, ...checks.map(checkOf)));
    } catch (error) {
      this.found.replaceChildren(element("p", { className: "small", role: "alert", textContent: said(error.message) }));
    }
    button.disabled = false;
  }
}

const STEPS = { follows: "the picture did not follow", force: "the force was not felt", stop: "the hand did not go limp" };

// What the journal says of an arm's newest test.
function toldOf(last) {
  if (!last) return t("Not tested yet.");
  const at = new Date(last.at_ns / 1e6).toLocaleString(locale());
  return last.passed ? t("Passed on {at}.", { at }) : t("Failed on {at}: {why}.", { at, why: t(STEPS[last.step]) });
}

function checkOf({ name, verdict, found, advice }) {
  const row = element("li", {}, element("b", { textContent: `${MARKS[verdict] ?? "·"} ${said(name)}` }), element("span", { textContent: said(found) }), advice ? element("span", { className: "small", textContent: said(advice) }) : "");
  row.dataset.verdict = verdict;
  return row;
}
