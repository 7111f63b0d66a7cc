// The sheet over the picture: the report of an attempt with its replay, the list of one's own attempts, and the curve.

import { element, text } from "../dashboard/rows.js";
import { clock } from "../attempt/words.js";
import { locale, said, t } from "./i18n.js";
import { cost, passesBy, what } from "./sentences.js";
import { Player } from "./player.js";
import { chart, Track } from "./track.js";

const $ = (id) => document.getElementById(id);
const LEAD_S = 2;

const HEADS = ["", "", "when", "task", "outcome", "time", "score", "errors", "", ""]; // of the list of attempts

export class Sheet {
  // school: who knows; view(): as it is now; onNext(): what "next task" does; onAgain(): the same task again
  // onMoment(line): goes on from a moment of a recording
  constructor(school, view, { onNext, onAgain, onMoment }) {
    Object.assign(this, { school, view, onNext, onAgain, onMoment });
    $("sheet-close").onclick = () => this.close();
    addEventListener("keydown", (event) => event.key === "Escape" && this.open && this.close());
  }

  get open() {
    return !$("sheet").hidden;
  }

  show(title) {
    $("sheet").hidden = false;
    text($("sheet-title"), title);
    this.view()?.rest?.(true);
    $("sheet").scrollTop = 0;
    $("sheet").focus();
  }

  close() {
    this.player?.close();
    this.player = null;
    $("sheet").hidden = true;
    this.view()?.rest?.(false);
  }

  // The report of an attempt, by its number. `next`: the next task, null for none.
  async report(number, next = null) {
    const report = await this.school.ask(`attempts/${number}`);
    for (const each of report.costs) each.words = cost(each);
    this.show(t("{who}: {title}", { who: report.trainee, title: said(report.title) }));
    const left = element("div", { className: "replay-box" }), right = element("div", { className: "report" });
    $("sheet-body").replaceChildren(left, right);
    right.replaceChildren(
      this.verdict(report), this.buttons(next), this.costs(report), this.advice(report), this.cholangiogram(report), await this.curve(report), this.ratings(report),
    );
    await this.replay(left, report);
  }

  verdict(report) {
    const points = report.score ? t("{points} points", { points: Math.round(report.score.total) }) : t("no score");
    const parts = [element("p", { className: `verdict ${report.level}`, textContent: said(report.verdict) })];
    parts.push(element("p", { className: "points" }, element("b", { textContent: points }), element("span", { textContent: ` ${t("in {time} of {most}", { time: clock(report.time_s), most: clock(report.time_limit_s) })}` })));
    if (!report.counts) parts.push(element("p", { className: "not", textContent: t("This attempt does not count: {why}.", { why: report.why_not.map(said).join("; ") }) }));
    if (report.slowest < 0.95) parts.push(element("p", { className: "small", textContent: t("The clock went as slow as {percent} % of real time, so that nothing was lost.", { percent: Math.round(100 * report.slowest) }) }));
    return element("section", {}, ...parts);
  }

  buttons(next) {
    const again = element("button", { id: "report-again", className: "action", textContent: t("Once more"), onclick: () => { this.close(); this.onAgain(); } });
    const on = next && element("button", { id: "report-next", className: "action go", textContent: t("Next task: {title}", { title: t(next.title) }), onclick: () => { this.close(); this.onNext(next); } });
    const told = next ? element("p", { className: "small", textContent: passesBy(next) }) : "";
    return element("section", { className: "controls" }, on || "", again, told);
  }

  costs(report) {
    const list = element("ul", { className: "costs" }, ...report.costs.map((each) => element("li", {},
      element("button", { className: "jump", textContent: clock(each.begin_s), title: t("See it in the replay"), onclick: () => this.jump(each.begin_s - LEAD_S) }),
      element("span", { textContent: each.words }))));
    const none = report.costs.length ? "" : element("p", { textContent: t("Nothing cost points but the time.") });
    return element("section", {}, element("h2", { textContent: t("What cost points") }), list, none);
  }

  advice(report) {
    return element("section", { className: "advice" }, element("h2", { textContent: t("Practise next") }), ...report.advice.map((each) => element("p", { textContent: said(each) })));
  }

  // The end of the attempt by X-rays, with what it shows; the school draws it now, which takes some seconds.
  cholangiogram(report) {
    if (!report.has_cholangiogram) return "";
    const told = element("p", { className: "message", textContent: t("The cholangiogram is drawn…") });
    const box = element("section", { id: "cholangiogram" }, element("h2", { textContent: t("Cholangiogram at the end") }), told);
    this.still(report.number).then(
      ({ image, words }) => told.replaceWith(
        element("img", { alt: words.map(said).join(" "), src: `data:image/png;base64,${image}` }),
        ...words.map((each) => element("p", { textContent: said(each) })),
      ),
      (error) => text(told, error.message),
    );
    return box;
  }

  // The school answers without an image while it still draws; it is asked again as long as the sheet is open.
  async still(number) {
    for (;;) {
      const found = await this.school.ask(`attempts/${number}/cholangiogram`);
      if (found.image || !this.open) return { image: "", words: [], ...found };
    }
  }

  async curve(report) {
    const box = element("section", {}, element("h2", { textContent: t("Your curve") }));
    const found = await this.school.ask(`curve?trainee=${encodeURIComponent(report.trainee)}&scenario=${encodeURIComponent(report.scenario)}`);
    box.append(...curveOf(found));
    return box;
  }

  // An instructor's ratings, as kept.
  ratings(report) {
    const rows = report.notes.filter(({ kind }) => kind !== "course").map(({ kind, by, data }) => {
      const words = kind === "bookmark" ? `${clock(data.at_s)} ${data.words}` : Object.entries(data).map(([name, points]) => `${t(name)} ${points}`).join(", ");
      const jump = kind === "bookmark" ? element("button", { className: "jump", textContent: clock(data.at_s), onclick: () => this.jump(data.at_s) }) : "";
      return element("li", {}, jump, element("span", { textContent: `${kind.toUpperCase()} (${by}): ${words}` }));
    });
    return rows.length ? element("section", {}, element("h2", { textContent: t("What your instructor says") }), element("ul", { className: "costs" }, ...rows)) : "";
  }

  async replay(box, report, other = null) {
    if (!report.has_replay) return box.replaceChildren(element("p", { className: "message", textContent: t("There are no pictures of this attempt: no page saw it.") }));
    box.replaceChildren(element("p", { className: "message", textContent: t("The replay is loaded…") }));
    try {
      const tracks = [await Track.load(this.school, report.attempt_id, report.from_tick)];
      if (other) tracks.push(await Track.load(this.school, other.attempt_id, other.from_tick));
      this.player?.close();
      this.player = new Player(box, this.view()?.governor?.step ?? { ratio: 1, look: "coarse", shadows: false });
      this.player.show(tracks, other ? [report, other].map(named) : [report.trainee], report);
      if (!other && report.source && report.from_tick >= 0) box.querySelector(".player").after(this.goOn(report));
      globalThis.trocar.player = this.player;
    } catch (error) {
      box.replaceChildren(element("p", { className: "message", textContent: error.message }));
    }
  }

  // Shows a second of the replay, which lies below the report on a narrow screen.
  jump(second) {
    this.player?.go(Math.max(0, second));
    this.player?.canvases.scrollIntoView({ block: "nearest" });
  }

  // Own hands go on from the second that is shown.
  goOn({ source, from_tick: first, scenario }) {
    const said = element("p", { id: "go-on-said", className: "small", role: "status" });
    const button = element("button", { id: "go-on", className: "action", textContent: t("Go on from here yourself"), onclick: async () => {
      const answer = await this.onMoment(`${source} ${first + Math.round(1000 * this.player.second)} ${scenario}`);
      text(said, answer.ok ? t("The rig runs your attempt again up to here; then the instruments are yours.") : answer.text);
    } });
    return element("div", { className: "controls" }, button, said);
  }

  // All attempts of a trainee: open one, or choose two to see side by side.
  async library(trainee) {
    const rows = await this.school.ask(`attempts?trainee=${encodeURIComponent(trainee)}`);
    this.show(t("Attempts of {who}", { who: trainee }));
    const chosen = new Set();
    const compare = element("button", { className: "action", textContent: t("Two side by side"), disabled: true, onclick: () => this.compare([...chosen]) });
    const example = element("button", { textContent: t("One beside the example"), disabled: true, onclick: () => this.compareWithExample([...chosen][0]) });
    const choose = (row, on) => {
      if (on) chosen.add(row);
      else chosen.delete(row);
      compare.disabled = chosen.size !== 2;
      example.disabled = chosen.size !== 1;
    };
    const table = element("table", { className: "attempts" }, element("thead", {}, element("tr", {}, ...HEADS.map((each) => element("th", { textContent: t(each) })))),
      element("tbody", {}, ...rows.map((row) => this.row(row, choose))));
    const none = rows.length ? "" : element("p", { textContent: t("None yet.") });
    $("sheet-body").replaceChildren(element("div", { className: "wide" }, element("div", { className: "controls" }, compare, example), element("div", { className: "scroll" }, table), none));
  }

  row(row, choose) {
    const tick = element("input", { type: "checkbox", disabled: !row.has_replay, onchange: (event) => choose(row, event.target.checked) });
    tick.setAttribute("aria-label", t("Choose attempt {n}", { n: row.id }));
    const outcome = `${t(row.outcome)}${row.counts ? "" : ` (${t("does not count")})`}${row.examined ? ` · ${t("examination")}` : ""}`;
    const save = row.has_replay ? element("button", { textContent: t("Download"), onclick: () => this.download(row) }) : "";
    const open = element("button", { className: "action", textContent: t("Open"), onclick: () => this.report(row.id) });
    const seen = element("img", { className: "seen", hidden: true, alt: t("the last picture of the attempt") });
    this.fill(seen, row.attempt_id);
    const cells = [tick, seen, when(row.began_ns), said(row.title), outcome, clock(row.time_s), row.total === null ? "–" : row.total.toFixed(0), String(row.errors), open, save];
    return element("tr", {}, ...cells.map((cell, i) => {
      const field = element("td", {}, cell);
      if (HEADS[i]) field.dataset.head = t(HEADS[i]); // shown where a narrow screen has no head above
      return field;
    }));
  }

  async fill(image, attemptId) {
    try {
      const answer = await this.school.ask(`last-picture/${attemptId}`, { raw: true }), reader = new FileReader();
      image.onload = () => (image.hidden = false);
      reader.onload = () => (image.src = reader.result);
      reader.readAsDataURL(await answer.blob());
    } catch {
      // no page saw its end
    }
  }

  async download(row) {
    const answer = await this.school.ask(`replay/${row.attempt_id}`, { raw: true });
    const link = element("a", { href: URL.createObjectURL(await answer.blob()), download: `${row.trainee}-${row.attempt_id}.view.gz` });
    link.click();
    URL.revokeObjectURL(link.href);
  }

  async compare([one, other]) {
    const report = { ...(await this.school.ask(`attempts/${one.id}`)), total: one.total };
    for (const each of report.costs) each.words = what(each.code);
    this.show(t("Two attempts at the same second"));
    const left = element("div", { className: "replay-box both" });
    $("sheet-body").replaceChildren(left);
    await this.replay(left, report, other);
  }

  async compareWithExample(row) {
    const { attempt_id: id } = await this.school.ask(`ghost/${row.scenario}`);
    if (id) await this.compare([row, { attempt_id: id, from_tick: -1, trainee: t("example") }]);
  }
}

export const when = (began_ns) => new Date(began_ns / 1e6).toLocaleString(locale(), { dateStyle: "medium", timeStyle: "short" });

// An attempt beside another one: whose it is, when it was made, and its points.
function named({ trainee, began_ns: began, total }) {
  return [trainee, began ? when(began) : "", typeof total === "number" ? t("{points} points", { points: Math.round(total) }) : ""].filter(Boolean).join(" · ");
}

// The learning curve: score by attempt with the experts' band, and CUSUM of failures.
export function curveOf({ score, cusum, band, band_of: behind }) {
  if (!score.length) return [element("p", { className: "small", textContent: t("No attempt counts yet.") })];
  const points = score.map((y, i) => [i + 1, y ?? 0]);
  const lines = band ? [{ y: band.mean, words: t("experts' mean"), kind: "goal" }, { y: Math.max(0, band.mean - 2 * band.deviation), words: t("proficient"), kind: "limit" }] : [];
  const dots = points.map(([x, y]) => ({ x, y, kind: "made", words: `${x}: ${Math.round(y)}` }));
  const found = [chart({ curves: [{ points, kind: "c0" }], lines, dots, whole: true, xWords: t("attempt"), yWords: t("score"), label: t("Score by attempt") })];
  const told = band ? t("The band is of {n} attempts of experts.", { n: behind }) : t("Nobody's attempts are named as references yet: there is no band.");
  found.push(element("p", { className: "small", textContent: told }));
  if (cusum.values.length > 1) {
    const cleared = [{ y: cusum.alarm, words: t("not acceptable above"), kind: "limit" }];
    found.push(chart({ curves: [{ points: cusum.values.map((y, i) => [i + 1, y]), kind: "c1" }], lines: cleared, height: 9, whole: true, xWords: t("attempt"), yWords: "CUSUM", label: t("CUSUM of failures") }));
  }
  return found;
}
