// The dashboard: five messages a second become curves, a heat map and tables.

import { COLOURS, forceChart, latencyChart, missChart } from "./charts.js";
import { givenUp, known, percent, us } from "./format.js";
import { HeatMap } from "./heat.js";
import { element, Rows, text } from "./rows.js";
import { said, t } from "../school/i18n.js";
import { Budget, Events, Judge, Processes, Realtime, Stages, Threads, Topics } from "./tables.js";

const $ = (id) => document.getElementById(id);
const KEPT = 600; // messages: two minutes
const FIRST_PATH = "device_force";
const QUANTILES = ["p50", "p99", "p99_9", "max"];

function label(name) {
  return name.replaceAll("_", " ");
}

class Tabs {
  constructor(parent, onChoice) {
    this.onChoice = onChoice;
    this.chosen = null;
    this.rows = new Rows(parent, (name) => {
      const tab = element("button", { textContent: label(name), onclick: () => this.choose(name) });
      tab.setAttribute("role", "tab");
      return tab;
    }, (tab, name) => tab.setAttribute("aria-selected", name === this.chosen));
  }

  update(names, preferred) {
    this.names = names;
    if (!names.includes(this.chosen)) this.chosen = names.includes(preferred) ? preferred : names[0] ?? null;
    this.rows.update(names, (name) => name);
  }

  choose(name) {
    this.chosen = name;
    this.update(this.names);
    this.onChoice();
  }
}

export class Dashboard {
  // `period()`: milliseconds between two showings, each with a picture (`turn`) while they come; 0: with every message. Where the
  // browser draws on the processor each frame of the page costs as much as a picture does, and all curves more than one.
  // `waits()`: whether everything but the rig's state is postponed, while a person waits for something else.
  // `peaks()`: largest force on each tool since it was asked last.
  constructor({ period = () => 0, waits = () => false, peaks = () => [] } = {}) {
    this.peaks = peaks;
    this.period = period;
    this.waits = waits;
    this.drawnAt = -Infinity;
    this.history = [];
    this.shown = null; // the message that the tables are of
    this.heat = new HeatMap($("heat"));
    this.paths = new Tabs($("path-tabs"), () => this.drawPath());
    this.loops = new Tabs($("heat-tabs"), () => this.heat.show(this.loops.chosen));
    this.latency = latencyChart($("path-chart"), () => this.path()?.limit_p99);
    this.tables = [new Processes(), new Budget(), new Stages(), new Threads(), new Realtime()];
    this.topics = new Topics();
    this.judge = new Judge();
    this.events = new Events();
    this.quantiles = [...QUANTILES, "answered"].map((name, i) => {
      const cell = element("div", {}, element("span", { textContent: name === "p99_9" ? "p99.9" : name }), element("b", { textContent: "–" }));
      if (i < 4) cell.firstChild.style.setProperty("--swatch", COLOURS[i]);
      return cell;
    });
    text(this.quantiles[4].firstChild, "next tick");
    this.quantiles[4].title = "share of device samples whose contact model is applied in the very next tick";
    $("path-now").append(...this.quantiles);
  }

  // Limits of the rig file. One line for all loops: the strictest budget.
  setContracts(contracts) {
    const budgets = Object.values(contracts?.loops ?? {}).map((loop) => loop.miss_ratio);
    this.missBudget = budgets.length ? Math.min(...budgets) : null;
  }

  link(message) {
    $("link-message").hidden = !message;
    text($("link-message"), message ?? "");
    $("dashboard").classList.toggle("stale", Boolean(message) && this.history.length > 0);
  }

  update(state) {
    if (this.history.length && state.t < this.history.at(-1).t) this.history = []; // the rig has started anew
    this.history.push({ t: state.t, paths: state.paths ?? [], loops: loopsOf(state), peaks: this.peaks() });
    if (this.history.length > KEPT) this.history.shift();
    this.state = state;
    this.heat.add(state.heat, Object.fromEntries(loopsOf(state).map(({ name, loop }) => [name, 1e6 / loop.target_hz])));
    if (document.visibilityState === "hidden") return;
    const words = `${state.state} ${state.safe_stop}`;
    if (words === this.words && performance.now() - this.drawnAt < 2 * this.period()) return;
    this.words = words;
    this.show();
  }

  // Draws now, as the browser makes a frame of the page anyway.
  turn() {
    const period = this.period();
    if (period && this.state && performance.now() - this.drawnAt >= period) this.show();
  }

  show() {
    const { state } = this;
    this.drawnAt = performance.now();
    this.showRig(state);
    if (document.body.classList.contains("alone") || document.body.dataset.face !== "engineer" || this.waits()) return;
    this.shown = state;
    for (const table of this.tables) table.update(state.processes ?? []);
    this.topics.update(state.topics ?? []);
    this.judge.update(state.judge);
    $("start-notice").hidden = !state.start_notice;
    text($("start-notice"), said(state.start_notice ?? ""));
    this.events.update(state.events ?? []);
    this.paths.update((state.paths ?? []).map((path) => path.name), FIRST_PATH);
    this.loops.update(Object.keys(state.heat ?? {}), "gateway");
    this.drawPath();
    this.drawForces();
    this.drawMisses();
    this.heat.show(this.loops.chosen);
  }

  showRig(state) {
    const badge = $("rig-badge");
    text(badge, t(state.safe_stop ? "safe stop" : label(state.state)).toUpperCase());
    badge.dataset.state = state.safe_stop ? "safe_stop" : state.state;
    if ($("rig-reason").dataset.own) return;
    text($("rig-reason"), [said(state.reason), givenUp(state)].filter(Boolean).join(" · "));
    $("rig-reason").title = said(state.reason ?? "");
  }

  path() {
    return this.state?.paths?.find((path) => path.name === this.paths.chosen);
  }

  drawPath() {
    const now = this.path();
    QUANTILES.forEach((q, i) => text(this.quantiles[i].lastChild, us(now?.[q])));
    const p99 = this.quantiles[1].lastChild;
    p99.className = known(now?.limit_p99) && known(now.p99) ? (now.ok ? "good" : "bad") : "";
    text(this.quantiles[4].lastChild, percent(this.state?.answered_next_tick));
    const rows = this.history.map(({ paths }) => paths.find((path) => path.name === this.paths.chosen));
    this.latency.set(this.history.map(({ t }) => t), QUANTILES.map((q) => rows.map((row) => row?.[q] ?? null)));
  }

  drawForces() {
    const names = this.history.at(-1).peaks.map(({ name }) => name);
    if (!names.length) return;
    if (names.join() !== this.forceNames) {
      $("force-chart").replaceChildren();
      this.forces = forceChart($("force-chart"), names, () => this.state?.attempt?.force_limit_n || null);
      this.forceNames = names.join();
      legend($("force-chart"), names);
    }
    const of = ({ peaks }, name) => peaks.find((peak) => peak.name === name)?.newton ?? null;
    this.forces.set(this.history.map(({ t }) => t), names.map((name) => this.history.map((message) => of(message, name))));
  }

  drawMisses() {
    const loops = loopsOf(this.state).map(({ name }) => name);
    if (!loops.length) return;
    if (loops.join() !== this.missNames) {
      $("miss-chart").replaceChildren();
      this.misses = missChart($("miss-chart"), loops, () => this.missBudget);
      this.missNames = loops.join();
      legend($("miss-chart"), loops);
    }
    this.misses.set(this.history.map(({ t }) => t), loops.map((name) =>
      this.history.map((message) => missRatio(message, name))));
  }

}

function legend(chart, names) {
  const head = chart.parentElement.querySelector("h2");
  head.querySelector(".legend")?.remove();
  head.append(element("span", { className: "legend" }, ...names.map((name, i) => {
    const entry = element("span", { textContent: name });
    entry.style.setProperty("--swatch", COLOURS[i % COLOURS.length]);
    return entry;
  })));
}

function missRatio({ loops }, name) {
  return loops.find((entry) => entry.name === name)?.loop.miss_ratio ?? null;
}

function loopsOf(state) {
  return (state.processes ?? []).filter((process) => process.loop?.target_hz);
}
