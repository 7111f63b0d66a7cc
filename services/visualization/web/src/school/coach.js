// Tells of a mistake while it happens: in words at its place in the picture, with a sound, once. Shows an example's hands on demand.

import { element, text } from "../dashboard/rows.js";
import { covering, freePlace } from "../view/room.js";
import { how, MISTAKES, what } from "./sentences.js";
import { t } from "./i18n.js";
import { Track } from "./track.js";

const $ = (id) => document.getElementById(id);
const SHOWN_MS = 5000, SAME_MS = 4000, BEEP_S = 0.16, BEEP_HZ = 392;
const STRONGEST = 0.55, MOST = 3, EDGE = 6; // mistakes at once, and pixels to the edge of the picture

export class Coach {
  // view(): as it is now; school: who is asked for an example
  constructor(view, school) {
    Object.assign(this, { view, school });
    this.ofCourse = "full";
    this.seen = { id: "", errors: {} };
    this.told = new Map();
    $("ghost").onclick = () => this.switchGhost();
  }

  // full, faded or none: in an examination nobody helps, whatever the course says.
  get mode() {
    return this.attempt?.examined ? "none" : this.ofCourse;
  }

  setMode(mode, successes = 0) {
    this.successes = successes;
    this.ofCourse = mode;
    this.showMode();
  }

  showMode() {
    const { mode } = this;
    document.body.dataset.coaching = mode;
    if (mode === "none") this.endGhost();
    $("ghost").disabled = mode === "none";
  }

  get strength() {
    return (this.mode === "faded" ? 0.5 : 1) * STRONGEST / (1 + (this.successes ?? 0) / 3);
  }

  update(attempt) {
    if (!attempt) return;
    if (document.body.dataset.coaching !== this.mode) this.showMode();
    const isKnown = this.seen.id !== ""; // what went wrong before the page was there is no news
    const before = !isKnown ? attempt.errors : attempt.attempt_id === this.seen.id ? this.seen.errors : {};
    for (const [code, count] of Object.entries(attempt.errors ?? {})) {
      if (attempt.state === "running" && count > (before[code] ?? 0)) this.tell(code);
    }
    this.seen = { id: attempt.attempt_id, errors: { ...attempt.errors } };
    if (this.track) this.showGhost(attempt);
  }

  tell(code, now = performance.now()) {
    if (this.mode === "none" || now - (this.told.get(code) ?? -SAME_MS) < SAME_MS) return;
    this.told.set(code, now);
    const { x, y } = this.placeOf(MISTAKES[code]?.at);
    const box = element("div", { className: "mistake-box" }, element("b", { textContent: what(code) }), element("span", { textContent: how(code) }));
    box.dataset.code = code;
    box.style.left = `${x}%`;
    box.style.top = `${y}%`;
    $("mistakes").append(box);
    while ($("mistakes").children.length > MOST || !this.keepClear(box)) $("mistakes").firstChild.remove();
    setTimeout(() => box.remove(), SHOWN_MS);
    beep();
  }

  // Beside the task, the forces, the buttons and other mistakes, which have to be read meanwhile. Returns false where an older
  // mistake has to make room for it.
  keepClear(box) {
    const wanted = box.getBoundingClientRect(), others = [...$("mistakes").children].filter((each) => each !== box);
    const placeOf = (each) => each.getBoundingClientRect(), view = placeOf($("view"));
    const within = { left: view.left + EDGE, top: view.top + EDGE, right: view.right - EDGE, bottom: view.bottom - EDGE };
    const names = document.querySelectorAll("#tags span"), found = freePlace(wanted, [...covering(), ...names, ...others].map(placeOf), within);
    if (!found) return !others.length; // alone it may lie over what is there
    box.style.left = `${found[0] - view.left + 0.5 * wanted.width}px`;
    box.style.top = `${found[1] - view.top + 1.1 * wanted.height}px`;
    return true;
  }

  // Where in the picture, in per cent, with room for the words.
  placeOf(at) {
    const view = this.view(), frame = view?.last, stage = view?.stage;
    if (!frame || !stage?.layout) return { x: 50, y: 40 };
    let point = stage.mouth.toArray();
    if (at === "tip" && frame.centreline.length) point = [...frame.centreline.slice(-3)];
    if (at === "hand") point = [...frame.poses.subarray(7 * loaded(frame), 7 * loaded(frame) + 3)];
    const { x, y } = stage.pixelOf(point), box = $("view").getBoundingClientRect();
    const share = (value, from, size, margin) => Math.min(100 - margin, Math.max(margin, (100 * (value - from)) / size));
    return { x: share(x, box.left, box.width, 22), y: share(y, box.top, box.height, 30) };
  }

  async switchGhost() {
    if (this.track) return this.endGhost();
    const { scenario } = this.attempt ?? {};
    try {
      const { attempt_id: id } = await this.school.ask(`ghost/${scenario}`);
      if (!id) return this.say(t("There is no example of this task yet: the first good attempt becomes one."));
      this.track = await Track.load(this.school, id, -1);
      $("ghost").setAttribute("aria-pressed", "true");
    } catch (error) {
      this.say(error.message);
    }
  }

  say(words) {
    text($("hand-hint"), words);
  }

  // The example's hands at this attempt's second; before it begins, again and again.
  showGhost(attempt) {
    const seconds = attempt.state === "running" ? attempt.time_s : (performance.now() / 1000) % (this.track.length + 1);
    const first = this.track.times[0] ?? 0;
    this.view()?.showGhost(this.track.at(seconds + first), this.strength);
  }

  endGhost() {
    this.track = null;
    $("ghost").setAttribute("aria-pressed", "false");
    this.view()?.stage && this.view().showGhost(null);
  }
}

// The tool with the larger force.
function loaded({ forces }) {
  const sizes = Array.from({ length: forces.length / 3 }, (_, i) => Math.hypot(...forces.subarray(3 * i, 3 * i + 3)));
  return Math.max(0, sizes.indexOf(Math.max(...sizes)));
}

let sound = null;

function beep() {
  try {
    sound ??= new AudioContext();
    const tone = sound.createOscillator(), gain = sound.createGain();
    tone.frequency.value = BEEP_HZ;
    gain.gain.setValueAtTime(0.12, sound.currentTime);
    gain.gain.exponentialRampToValueAtTime(1e-3, sound.currentTime + BEEP_S);
    tone.connect(gain).connect(sound.destination);
    tone.start();
    tone.stop(sound.currentTime + BEEP_S);
  } catch {
    // a browser without sound shows the words all the same
  }
}
