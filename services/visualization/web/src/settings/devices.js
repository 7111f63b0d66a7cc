// Devices: what the host says of them, and a test of each arm step by step, ticked as each step is seen to happen.

import { element, text } from "../dashboard/rows.js";
import { t } from "../school/i18n.js";

const PRESSED_N = 0.2, FREE_N = 0.05;
const MARKS = { ok: "✓", warn: "!", fail: "✗" };
const SHOWN_EVENTS = 6;

// Steps of the test, given the instruments; each says whether what it asks for is seen now.
export function stepsFor(instruments) {
  const pressed = instruments.map(({ name }, i) => ({
    words: t("Press {name} gently against the duct until {newton} N are read. You should feel it, and no buzzing.", { name: t(name), newton: PRESSED_N }),
    seen: ({ forces }) => (forces[i] ?? 0) >= PRESSED_N,
  }));
  return [
    { words: t("The rig runs, and no device has a fault. An arm that must be calibrated says below how."), seen: ({ state }) => state === "running" || state === "degraded" },
    { words: t("Press “Arm”: the arms may push."), seen: ({ stopped, state }) => !stopped && state !== "failed" },
    ...pressed,
    { words: t("Draw back: the force is gone."), seen: ({ forces }) => forces.length > 0 && forces.every((newton) => newton < FREE_N) },
    { words: t("Press against the duct again, and then “Safe stop”: every hand goes limp at once."), seen: ({ stopped }) => stopped },
    { words: t("Press “Arm” again to go on."), seen: ({ stopped }) => !stopped },
  ];
}

// Goes through the steps one after the other: a step counts from when the one before was seen.
export class Walk {
  constructor(steps) {
    this.steps = steps;
    this.done = 0;
  }

  see(now) {
    if (this.done < this.steps.length && this.steps[this.done].seen(now)) this.done++;
  }
}

export class Devices {
  // school: who asks the host; view(): as it is now, which knows the forces
  constructor(school, view) {
    Object.assign(this, { school, view });
    this.walk = null;
  }

  show({ instruments, is_running: runs }) {
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
    const again = element("button", { id: "felt-begin", textContent: t("Begin the test"), onclick: () => this.begin() });
    this.begin();
    return [
      host,
      element("section", {}, element("h2", { textContent: t("Felt test") }), element("p", { className: "small", textContent: t("One hand at the arm, the other at Safe stop (Escape). Each step is ticked when it is seen.") }), this.list, this.read, element("div", { className: "controls" }, again)),
      element("section", {}, element("h2", { textContent: t("What the rig says of its devices") }), this.events),
    ];
  }

  begin() {
    this.walk = new Walk(stepsFor(this.instruments));
    this.draw();
  }

  draw() {
    this.list.replaceChildren(...this.walk.steps.map(({ words }, i) => {
      const state = i < this.walk.done ? "done" : i === this.walk.done ? "now" : "later", step = element("li", { textContent: words });
      step.dataset.state = state;
      if (state === "now") step.setAttribute("aria-current", "step");
      return step;
    }));
  }

  update({ state, safe_stop: stopped, events = [] }) {
    if (!this.walk || !this.list?.isConnected) return;
    const forces = this.view()?.felt ?? [], before = this.walk.done;
    this.walk.see({ state, stopped: Boolean(stopped) || state === "safe_stop", forces });
    if (this.walk.done !== before) this.draw();
    text(this.read, this.instruments.map(({ name }, i) => `${t(name)}: ${(forces[i] ?? 0).toFixed(2)} N`).join(" · "));
    const ours = events.filter(({ text: words }) => /gateway|arm|device|calibrat/i.test(words)).slice(-SHOWN_EVENTS).map(({ text: words }) => words);
    if (ours.join() === this.told) return;
    this.told = ours.join();
    this.events.replaceChildren(...(ours.length ? ours : [t("Nothing.")]).map((words) => element("li", { textContent: words })));
  }

  async check(button) {
    button.disabled = true;
    this.found.replaceChildren(element("p", { className: "small", role: "status", textContent: t("The host is asked; that takes some seconds.") }));
    try {
      const checks = await this.school.ask("settings/devices");
      this.found.replaceChildren(element("ul", { className: "checks" }, ...checks.map(checkOf)));
    } catch (error) {
      this.found.replaceChildren(element("p", { className: "small", role: "alert", textContent: error.message }));
    }
    button.disabled = false;
  }
}

function checkOf({ name, verdict, found, advice }) {
  const row = element("li", {}, element("b", { textContent: `${MARKS[verdict] ?? "·"} ${name}` }), element("span", { textContent: found }), advice ? element("span", { className: "small", textContent: advice }) : "");
  row.dataset.verdict = verdict;
  return row;
}
