// Plays the pictures of attempts: one, or two side by side at the same second, with the tracks of the first in step below.

import { colourOfForce } from "../view/colours.js";
import { canvasFor, Stage } from "../view/stage.js";
import { element, text } from "../dashboard/rows.js";
import { clock } from "../attempt/words.js";
import { t } from "./i18n.js";
import { chart } from "./track.js";

const SHOWN_MS = 83;

export class Player {
  // box: the element to fill; step: how finely to draw
  constructor(box, step) {
    this.step = step;
    this.screens = [];
    this.tracks = [];
    this.charts = [];
    this.second = 0;
    this.rate = 1;
    this.canvases = element("div", { className: "screens" });
    this.play = element("button", { className: "action", textContent: t("Play"), onclick: () => this.toggle() });
    this.place = element("input", { type: "range", min: 0, step: 0.01, value: 0, oninput: () => this.go(Number(this.place.value)) });
    this.place.setAttribute("aria-label", t("Second of the attempt"));
    this.time = element("output", { textContent: "0:00.0" });
    const slower = element("select", { onchange: () => (this.rate = Number(slower.value)) }, ...[0.25, 0.5, 1, 2].map((rate) => element("option", { value: rate, textContent: `× ${rate}`, selected: rate === 1 })));
    slower.setAttribute("aria-label", t("Rate"));
    this.asSeen = element("button", { textContent: t("As seen"), title: t("Look as the person did who made the attempt"), onclick: () => this.lookAsSeen(this.asSeen.getAttribute("aria-pressed") !== "true") });
    this.below = element("div", { className: "tracks" });
    box.replaceChildren(this.canvases, element("div", { className: "player" }, this.play, this.place, this.time, slower, this.asSeen), this.below);
  }

  // tracks: of `Track`, with names; the first one's curves are drawn below
  show(tracks, names, report) {
    this.stop();
    this.tracks = tracks;
    this.screens.forEach(({ stage }) => stage.renderer.dispose());
    this.screens = tracks.map((track, i) => this.screen(track, names[i]));
    this.place.max = Math.max(0.01, ...tracks.map((track) => track.length)).toFixed(2);
    this.drawTracks(report, names.length > 1 ? names[0] : "");
    this.asSeen.hidden = !tracks.some(({ seen }) => seen.length);
    this.lookAsSeen(false);
    this.go(0);
  }

  screen(track, name) {
    const canvas = element("canvas"), box = element("figure", {}, canvas, element("figcaption", { textContent: name }));
    this.canvases.append(box);
    while (this.canvases.children.length > this.tracks.length) this.canvases.firstChild.remove();
    const drawnOn = canvasFor(canvas), stage = new Stage(drawnOn, this.step);
    drawnOn.canvas.setAttribute("aria-label", t("Replay of the attempt of {name}", { name }));
    stage.lens.object.visible = false;
    stage.controls.enableDamping = false;
    stage.setLayout(track.layout);
    const screen = { stage, track, canvas: drawnOn.canvas, box };
    stage.controls.addEventListener("change", () => this.draw(screen));
    new ResizeObserver(() => this.size(screen)).observe(box);
    this.size(screen);
    return screen;
  }

  size(screen) {
    const width = screen.box.clientWidth, height = Math.round(0.62 * width);
    if (!width) return;
    screen.canvas.style.height = `${height}px`;
    screen.stage.resize(width, height);
    this.draw(screen);
  }

  draw(screen) {
    const frame = screen.track.at(this.second);
    if (!frame || screen.draws) return;
    screen.draws = true; // the eye may be moved by what is drawn, which asks for it to be drawn
    screen.stage.update(frame, colourOfForce);
    const eye = this.seesAs ? screen.track.eyeAt(this.second) : null;
    if (eye) screen.stage.seeAs(eye);
    screen.stage.draw();
    screen.draws = false;
  }

  // With the eye that saw it, or from where one turns the view to.
  lookAsSeen(on) {
    this.seesAs = on;
    this.asSeen.setAttribute("aria-pressed", on);
    for (const screen of this.screens) {
      screen.stage.controls.enabled = !on;
      if (!on) screen.stage.lookFrom("scope");
      this.draw(screen);
    }
  }

  go(second) {
    this.second = Math.min(Math.max(0, second), Number(this.place.max));
    this.place.value = this.second.toFixed(2);
    text(this.time, `${clock(this.second)}.${Math.floor((this.second * 10) % 10)}`);
    for (const each of this.charts) each.place(this.second);
    for (const screen of this.screens) this.draw(screen);
  }

  toggle() {
    if (this.timer) return this.stop();
    if (this.second >= Number(this.place.max) - 0.05) this.go(0);
    let last = performance.now();
    this.timer = setInterval(() => {
      const now = performance.now();
      this.go(this.second + ((now - last) / 1000) * this.rate);
      last = now;
      if (this.second >= Number(this.place.max)) this.stop();
    }, SHOWN_MS);
    text(this.play, t("Halt"));
  }

  stop() {
    clearInterval(this.timer);
    this.timer = null;
    text(this.play, t("Play"));
  }

  close() {
    this.stop();
    for (const { stage } of this.screens) {
      stage.controls.dispose();
      stage.renderer.dispose();
      stage.renderer.forceContextLoss();
    }
    this.screens = [];
    this.canvases.replaceChildren();
  }

  // whose: whose curves they are, where that must be said
  drawTracks(report, whose) {
    if (!report) return this.below.replaceChildren();
    const { series, limits } = report, zip = (values) => series.time_s.map((x, i) => [x, values[i] ?? 0]);
    const dots = (y) => report.costs.map(({ code, begin_s: x, words }) => ({ x, y, kind: "mistake", words: words ?? code }));
    const forces = Object.entries(series.loads_n).map(([name, values], i) => ({ points: zip(values), kind: `c${i}`, name }));
    const pick = (x) => this.go(x);
    this.charts = [
      chart({ curves: [{ points: zip(series.inserted_mm), kind: "c0" }], lines: [{ y: 1000 * report.goal_depth_m, words: t("goal"), kind: "goal" }], dots: dots(0), yWords: t("depth, mm"), xWords: "s", label: t("Depth over time"), onPick: pick }),
      chart({ curves: forces, lines: [{ y: limits.tool_duct, words: t("limit"), kind: "limit" }], dots: dots(0), yWords: t("force, N"), xWords: "s", label: t("Force on each hand over time"), onPick: pick }),
    ];
    const legend = element("p", { className: "small" }, whose, ...forces.map(({ name }, i) => element("span", { className: `legend-c${i}`, textContent: t(name) })));
    this.below.replaceChildren(...this.charts, legend);
  }
}
