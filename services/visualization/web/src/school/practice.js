// A practice of a minute: teaches the controls one after the other, each until it was used.

import { text } from "../dashboard/rows.js";
import { t } from "./i18n.js";

const $ = (id) => document.getElementById(id);
const MOVED_MM = 8, LOWERED_MM = 4, LOOKED_MM = 10;
const distance = (a, b) => Math.hypot(...a.map((x, i) => x - b[i]));

// Each: what to do, and whether it was done since it was asked for: `now` and `then` are what `look` returns.
const STEPS = [
  { ask: "Press “Take the instruments” below the picture.", done: ({ hand }) => Boolean(hand) },
  { ask: "Press the left button in the picture and drag: the instrument follows.", done: (now, then) => level(now, then) > MOVED_MM },
  { ask: "Turn the wheel: the instrument goes down, and up again.", done: (now, then) => Math.abs(now.jaws[2] - then.jaws[2]) > LOWERED_MM },
  { ask: "Click once into the picture: the jaws close.", done: (now) => now.opening === 0 },
  { ask: "Click again: they open.", done: (now) => now.opening === 1 },
  { ask: "Press “Hand” below: now you hold the other one.", done: (now, then) => now.active !== then.active },
  { ask: "Press the right button and drag: you look from elsewhere. “Scope” looks as before.", done: (now, then) => distance(now.eye, then.eye) > LOOKED_MM },
];

const level = (now, then) => Math.hypot(now.jaws[0] - then.jaws[0], now.jaws[1] - then.jaws[1]);

export class Practice {
  // hands(), view(): as they are now; onEnd(): called once all was tried, or it was left
  constructor(hands, view, onEnd) {
    Object.assign(this, { hands, view, onEnd });
    $("practice-skip").onclick = () => this.next();
    $("practice-end").onclick = () => this.end();
  }

  begin() {
    this.at = -1;
    $("practice").hidden = false;
    this.next();
    this.timer ??= setInterval(() => this.turn(), 150);
  }

  get runs() {
    return !$("practice").hidden;
  }

  look() {
    const hands = this.hands(), hand = hands?.grip, stage = this.view()?.stage;
    return {
      hand, active: hands?.active ?? 0, jaws: hand ? [...hand.jaws] : [0, 0, 0], opening: hand?.opening ?? 1,
      eye: stage ? stage.camera.position.toArray() : [0, 0, 0],
    };
  }

  turn() {
    const step = STEPS[this.at], now = this.look();
    if (!step || (this.at > 0 && !now.hand)) return;
    if (!this.then || (this.at > 0 && !this.then.hand)) this.then = now;
    if (step.done(now, this.then)) this.next();
  }

  next() {
    this.at++;
    this.then = this.at > 0 ? this.look() : null;
    if (this.at >= STEPS.length) return this.end();
    text($("practice-count"), t("{n} of {all}", { n: this.at + 1, all: STEPS.length }));
    text($("practice-ask"), t(STEPS[this.at].ask));
  }

  end() {
    clearInterval(this.timer);
    this.timer = null;
    $("practice").hidden = true;
    this.onEnd();
  }
}
