// The school at the page: who trains, the practice of the controls, the course, and what follows an attempt.

import { element, text } from "../dashboard/rows.js";
import { School } from "./client.js";
import { Coach } from "./coach.js";
import { LANGUAGES, language, said, setLanguage, t } from "./i18n.js";
import { Keeper } from "./keeper.js";
import { Practice } from "./practice.js";
import { passesBy } from "./sentences.js";
import { Sheet } from "./sheet.js";

const $ = (id) => document.getElementById(id);
const NAME = "trocar-trainee", KNOWS = "trocar-knows-controls";
const ASK_MS = 2000, PULSE_MS = 1000, REPORT_MS = 300, REPORT_TRIES = 40;

export class SchoolPage {
  // orders: of the attempt; view(), hands(): as they are now
  constructor(orders, view, hands) {
    Object.assign(this, { orders, view, hands });
    this.school = new School();
    this.keeper = new Keeper(this.school);
    this.coach = new Coach(view, this.school);
    this.practice = new Practice(hands, view, () => this.practised());
    this.sheet = new Sheet(this.school, view, { onNext: (step) => this.begin(step), onAgain: () => this.again(), onMoment: (line) => this.orders.post("api/take_over", line) });
    $("moment-back").onclick = () => this.orders.post("api/scenario", this.rig.scenario);
    this.state = null;
    this.handled = null;
    $("who").onclick = () => this.welcome();
    $("my-attempts").onclick = () => this.guard(() => this.sheet.library(this.state?.trainee || "guest"));
    $("keys-open").onclick = () => $("keys").showModal();
    for (const button of document.querySelectorAll("dialog [data-close]")) button.onclick = () => button.closest("dialog").close();
    addEventListener("keydown", (event) => {
      if (event.key === "?" && !/^(INPUT|TEXTAREA|SELECT)$/.test(event.target?.tagName ?? "")) $("keys").showModal();
    });
    const languages = Object.entries(LANGUAGES).map(([value, textContent]) => element("option", { value, textContent, selected: value === language }));
    $("language").replaceChildren(...languages);
    $("language").onchange = () => {
      setLanguage($("language").value);
      location.reload();
    };
  }

  admit(token) {
    this.school.token = token;
    this.listen();
  }

  setRig(rig) {
    this.rig = rig;
    $("moment").hidden = !rig.goes_on_from;
    this.listen();
  }

  // Asks until the school answers: it starts once the rig runs.
  async listen() {
    clearTimeout(this.timer);
    const isFor = this.school.token && this.rig?.hands?.length;
    for (const id of ["who", "my-attempts"]) $(id).hidden = !isFor;
    if (!isFor) return;
    try {
      await this.refresh();
      if (!this.entered) await this.enter();
    } catch {
      // it has not started yet
    }
    if (this.entered) return this.pulse();
    this.timer = setTimeout(() => this.listen(), ASK_MS);
  }

  // Each second: a message of the instructor, another trainee, and a small picture while somebody at a desk looks.
  async pulse() {
    try {
      const { watched, message, trainee, last } = await this.school.ask("pulse");
      this.tellMessage(message);
      if (trainee !== this.state?.trainee || last !== this.state?.last) await this.refresh();
      if (watched) await this.sendPicture();
    } catch {
      // the school is started again, or the rig has ended
    }
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.pulse(), PULSE_MS);
  }

  async sendPicture() {
    const stage = this.view()?.stage;
    if (!stage?.layout || this.sheet.open) return;
    const image = await this.smallPicture();
    if (image) await this.school.ask("picture", { method: "PUT", body: image });
  }

  smallPicture() {
    this.view().stage.draw();
    const small = Object.assign(document.createElement("canvas"), { width: 320, height: 200 });
    small.getContext("2d").drawImage(this.view().canvas, 0, 0, 320, 200);
    return new Promise((done) => small.toBlob(done, "image/jpeg", 0.7));
  }

  // The last picture of an attempt, by which it is found in the list.
  async keepPicture(attemptId) {
    const image = this.view()?.stage?.layout && (await this.smallPicture());
    if (image) await this.school.ask(`last-picture/${attemptId}`, { method: "PUT", body: image });
  }

  async refresh() {
    this.take(await this.school.ask("state"));
  }

  take(state) {
    this.state = state;
    text($("who"), state.trainee || t("Who are you?"));
    const { next } = state, here = next && next.scenario === this.attempt?.scenario;
    text($("course-now"), state.trainee && next ? `${t(state.course.title)} ${next.number}/${next.of}: ${t(next.title)}` : state.done ? t("Course finished") : "");
    $("course-now").title = next ? passesBy(next) : "";
    this.coach.setMode(next && here ? next.coaching : "full", next?.done ?? 0);
    text($("school-remark"), said(state.rest || state.remark));
  }

  tellMessage(newest) {
    if (!newest || newest.id === this.read) return;
    this.read = newest.id;
    text($("desk-message"), `${newest.by}: ${newest.words}`);
    $("desk-message").hidden = false;
    setTimeout(() => ($("desk-message").hidden = true), 20_000);
  }

  async enter() {
    this.entered = true;
    const kept = keptName();
    if (this.state.trainee) return; // an instructor has said who sits here, or the page was loaded anew
    if (kept) {
      try {
        return this.take(await this.school.post("enter", { trainee: kept }));
      } catch {
        // a PIN is asked for
      }
    }
    if (document.body.dataset.face === "trainee") this.welcome();
  }

  async welcome() {
    const box = $("welcome-body"), { name } = await this.school.ask("name").catch(() => ({ name: "" }));
    const known = this.state?.trainees ?? [];
    const field = element("input", { id: "own-name", maxLength: 64, placeholder: t("another name"), autocomplete: "off" });
    field.setAttribute("aria-label", t("another name"));
    const pin = element("input", { id: "own-pin", type: "password", maxLength: 32, placeholder: t("PIN, if you have one"), autocomplete: "off" });
    pin.setAttribute("aria-label", t("PIN, if you have one"));
    const come = async (trainee) => {
      try {
        this.take(await this.school.post("enter", { trainee, pin: pin.value }));
        keepName(trainee);
        this.chooseCourse();
      } catch (error) {
        text($("welcome-said"), error.message);
      }
    };
    const fresh = element("button", { id: "new-name", className: "action go", textContent: t("I am new: call me {name}", { name }), onclick: () => come(name) });
    const own = element("button", { textContent: t("Use this name"), onclick: () => field.value && come(field.value.trim()) });
    text($("welcome-title"), t("Who trains?"));
    text($("welcome-said"), t("A made-up name is enough: your attempts are kept under it, and nothing else of you is."));
    box.replaceChildren(fresh, element("div", { className: "names" }, ...known.map((each) => element("button", { textContent: each, onclick: () => come(each) }))), element("div", { className: "controls" }, field, pin, own));
    if (!$("welcome").open) $("welcome").showModal();
  }

  chooseCourse() {
    if (this.state.course) return this.afterCourse();
    text($("welcome-title"), t("Which course, {name}?", { name: this.state.trainee }));
    text($("welcome-said"), "");
    const pick = async (course) => {
      this.take(await this.school.post("course", { course }));
      this.afterCourse();
    };
    $("welcome-body").replaceChildren(
      ...this.state.courses.map(({ name, title, about, tasks }) => element("button", { className: "course", onclick: () => pick(name) },
        element("b", { textContent: t(title) }), element("span", { textContent: `${t(about)} ${t("{n} tasks", { n: tasks })}` }))),
      element("button", { textContent: t("No course: I only practise"), onclick: () => this.afterCourse() }),
    );
    $("welcome-body").querySelector("button").id = "first-course";
  }

  afterCourse() {
    if (knowsControls()) return $("welcome").close();
    text($("welcome-title"), t("Do you know the controls?"));
    text($("welcome-said"), t("They are shown one after the other, while you try them: it takes a minute."));
    const show = () => {
      $("welcome").close();
      this.practice.begin();
    };
    const known = () => {
      keepKnows();
      $("welcome").close();
    };
    $("welcome-body").replaceChildren(
      element("button", { id: "show-controls", className: "action go", textContent: t("Show me the controls"), onclick: show }),
      element("button", { id: "know-controls", textContent: t("I know them"), onclick: known }),
    );
  }

  practised() {
    keepKnows();
    this.orders.ask("new");
  }

  update(attempt) {
    this.attempt = this.coach.attempt = attempt;
    if (!this.practice.runs) this.coach.update(attempt);
    if (!attempt) return;
    this.handled ??= attempt.state === "done" ? attempt.attempt_id : ""; // what ended before the page was there
    this.keeper.follow(attempt).catch((error) => text($("school-remark"), error.message));
    const examines = this.coach.ofCourse === "none";
    if (this.state?.trainee && attempt.examined !== examines && attempt.state === "armed" && !this.asked) {
      this.asked = true;
      this.orders.ask("examine", examines ? 1 : 0).finally(() => setTimeout(() => (this.asked = false), 1000));
    }
    if (attempt.state !== "done") this.handled = this.handled === attempt.attempt_id ? this.handled : "";
    else if (this.handled !== attempt.attempt_id) {
      this.handled = attempt.attempt_id;
      if (this.practice.runs) return;
      this.guard(() => this.keepPicture(attempt.attempt_id));
      this.tellResult(attempt.attempt_id);
    }
  }

  // The report of an attempt, as soon as the school has judged and kept it, and its pictures are there.
  async tellResult(attemptId, tries = REPORT_TRIES) {
    if (document.body.dataset.face !== "trainee" || !this.school.token) return;
    try {
      const rows = await this.school.ask(`attempts?trainee=${encodeURIComponent(this.state?.trainee || "guest")}`);
      const row = rows.find((each) => each.attempt_id === attemptId);
      if (row && (row.has_replay || tries < REPORT_TRIES - 8)) {
        await this.refresh();
        return await this.sheet.report(row.id, this.state.next);
      }
    } catch (error) {
      text($("school-remark"), error.message);
    }
    if (tries > 0 && this.handled === attemptId) setTimeout(() => this.tellResult(attemptId, tries - 1), REPORT_MS);
  }

  again() {
    this.orders.ask("new");
  }

  // Begins a task: here, or in a rig of its scenario.
  async begin(step) {
    if (step.scenario === this.attempt?.scenario) return this.orders.ask("new");
    await this.orders.post("api/scenario", step.scenario);
  }

  guard(call) {
    call().catch((error) => text($("school-remark"), error.message));
  }
}

function read(key) {
  try {
    return localStorage.getItem(key) ?? "";
  } catch {
    return "";
  }
}

function write(key, value) {
  try {
    localStorage.setItem(key, value);
  } catch {
    // this browser stores nothing for the page: it asks again the next time
  }
}

const keptName = () => read(NAME);
const keepName = (name) => write(NAME, name);
const knowsControls = () => read(KNOWS) === "yes";
const keepKnows = () => write(KNOWS, "yes");
