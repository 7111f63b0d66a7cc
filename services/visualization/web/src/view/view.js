// The view: stream, stage, and the figures drawn over them.

import { jawsAt } from "../hands/motion.js";
import { said, t } from "../school/i18n.js";
import { force } from "../dashboard/format.js";
import { colourOfForce } from "./colours.js";
import { Governor, ladder } from "./governor.js";
import { Film, nameOf, save } from "./keep.js";
import { covering, roomBeside } from "./room.js";
import { canvasFor, Stage } from "./stage.js";
import { FULL, SCALE } from "./strain.js";

const FORCE_FULL_N = 3, NEAR = 0.7; // of the limit: the gauge warns before it is too much
const SCALE_STEPS_MM = [1, 2, 5, 10, 20, 50, 100];
const LOOK_MS = 1000;
const TAG_PX = { width: 60, height: 34 }; // a tool's name, with the way up to it from where the tool is
const TIMED_EVERY = 10; // of so many pictures one is waited for, to know what it took

const $ = (id) => document.getElementById(id);

export class View {
  // onTurn(): what else is to be shown in a frame of the page; each frame costs a processor that draws, whatever is in it.
  // attempt: the `AttemptPanel`, which knows what each hand holds and what it may press with.
  constructor(onTurn = () => {}, attempt = null) {
    this.onTurn = onTurn;
    this.attempt = attempt;
    this.peaks = [];
    this.felt = []; // by the last frame: what holds where no new one came
    this.frames = 0;
    this.drawnAt = 0;
    this.changed = true;
    this.costs = [];
    this.starting = "";
    this.covered = []; // boxes of the page over the picture, as they were when last looked at
    this.since = performance.now();
    const drawnOn = canvasFor($("scene"));
    ({ canvas: this.canvas, software: this.software } = drawnOn);
    this.governor = new Governor(ladder(this.software, devicePixelRatio), this.software);
    try {
      this.stage = new Stage(drawnOn, this.governor.step);
    } catch (error) {
      this.say(t("This browser cannot draw in 3-D ({why}). The dashboard works all the same.", { why: error.message }));
      return;
    }
    this.stage.room = () => roomBeside($("view").getBoundingClientRect(), covering().map((each) => each.getBoundingClientRect()));
    new ResizeObserver(() => this.resize()).observe($("view"));
    for (const each of document.querySelectorAll(".hud.top, #hands, #replay")) new ResizeObserver(() => this.makeRoom()).observe(each);
    this.resize();
    this.bindButtons();
    this.say(t("Waiting for the view…"));
    this.showStep();
    document.addEventListener("visibilitychange", () => this.beginAnew());
    this.stage.controls.addEventListener("change", () => this.request());
    setInterval(() => this.request(), LOOK_MS);
  }

  // Shows the frames of a stream of this page's rig.
  follow(stream) {
    this.stream = stream;
    stream.handlers = {
      onLayout: (layout) => this.setLayout(layout),
      onFrame: () => this.request(),
      onRig: (rig) => this.setRig(rig),
      onLink: (text) => this.say(this.starting || (text ?? "")),
    };
    stream.want(this.governor.step.hz);
  }

  // While the rig starts that is told, not that there is no picture yet.
  tellStart(text) {
    if (text || this.starting) this.say(text);
    this.starting = text;
  }

  say(text) {
    $("view-message").textContent = said(text);
    $("view-message").hidden = !text;
  }

  setLayout(layout) {
    this.stage.setLayout(layout);
    this.beginAnew(); // making it was work of another kind
    $("view").classList.add("ready");
    $("tools").replaceChildren(...layout.tools.map((tool) => toolRow(tool.name)));
    this.rows = [...$("tools").children].map((row) => ({
      row, bar: row.querySelector("i"), limit: row.querySelector("u"), value: row.querySelector("output"),
      jaw: row.querySelector("small"), held: row.querySelector("em"),
    }));
    $("tags").replaceChildren(...layout.tools.map((tool) => Object.assign(document.createElement("span"), { textContent: t(tool.name) })));
  }

  setRig(rig) {
    $("rig-badge").textContent = t(rig.safe_stop ? "safe stop" : rig.state.replace("_", " ")).toUpperCase();
    $("rig-badge").dataset.state = rig.safe_stop ? "safe_stop" : rig.state;
    $("rig-badge").title = said(rig.reason);
  }

  bindButtons() {
    for (const button of document.querySelectorAll("[data-preset]")) {
      button.onclick = () => this.stage.layout && this.stage.lookFrom(button.dataset.preset);
    }
    this.setMirrored = toggle($("mirror"), (on) => {
      $("view").classList.toggle("mirrored", on);
      $("instructor-mirror").setAttribute("aria-pressed", on);
      this.stage.mirrored = on;
      this.ask();
    });
    toggle($("vignette"), (on) => this.ask(() => (this.stage.lens.object.visible = on)));
    toggle($("forces"), (on) => this.askAgain(() => (this.stage.showForces = on)));
    toggle($("aim"), (on) => this.askAgain(() => (this.stage.showRings = on)));
    toggle($("strain"), (on) => {
      $("strain-scale").hidden = !on;
      this.ask(() => this.stage.showStrain(on, this.last));
    });
    $("strain-scale").querySelector("i").style.background = SCALE;
    $("strain-scale").querySelector("b").textContent = t("{share} % longer", { share: 100 * FULL });
    $("keep-picture").onclick = () => this.keepPicture();
    const film = new Film(this.canvas);
    $("keep-film").disabled = !film.format;
    $("keep-film").title = t(film.format ? "Film the view, until pressed again; the file is saved here" : "This browser cannot film");
    toggle($("keep-film"), (on) => {
      if (on) film.begin();
      else film.end();
      this.ask();
    });
  }

  // Draws nothing while something else covers it, such as a report.
  rest(on) {
    this.rests = on;
    if (!on) this.ask();
  }

  // Shows hands of another attempt in the picture, see `Stage.setGhost`; null for none.
  showGhost(frame, strength) {
    this.stage.showGhost(frame, strength);
    this.ask();
  }

  // The view as it is, as a file: drawn in the same turn, as a browser keeps no picture beyond it.
  keepPicture() {
    if (!this.stage.layout) return;
    this.stage.draw();
    this.canvas.toBlob((blob) => blob && save(blob, nameOf("png")), "image/png");
  }

  // As `ask`, of what the last frame shows.
  askAgain(change) {
    this.ask(() => {
      change();
      if (this.last) this.stage.update(this.last, colourOfForce);
    });
  }

  // A scenario may ask for a mirrored view; a person may revert this.
  startMirrored(on) {
    if (on === this.scenarioMirrored) return;
    this.scenarioMirrored = on;
    if (on) this.setMirrored(true);
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = $("view");
    if (width && height) this.ask(() => this.stage.resize(width, height));
  }

  // Looks anew where what covers the picture has grown; not under a hand, to which the picture would jump.
  makeRoom() {
    if (!$("hands").classList.contains("taken")) this.ask(() => this.stage.lookAgain());
  }

  // Applies `change`, and draws the view again.
  ask(change = () => {}) {
    change();
    this.changed = true;
    this.request();
  }

  // An animation frame, once; between them the browser has nothing to do, which costs a processor that draws less than to find that out.
  request() {
    if (this.requested) return;
    this.requested = true;
    requestAnimationFrame(() => this.animate());
  }

  // Draws if something is new: a picture of the rig, or another look at it. A still picture costs nothing.
  animate() {
    this.requested = false;
    const now = performance.now(), frame = this.stream?.take();
    if (frame) {
      this.stage.update(frame, colourOfForce);
      this.stream.painted(frame);
      this.frames++;
      const isFirst = !this.last;
      this.last = frame;
      if (isFirst) this.showFigures();
    }
    const moved = this.stage.moved();
    this.changed ||= moved || Boolean(frame);
    if (this.stage.layout && this.changed && !this.rests && (frame || this.isTimeToDraw(now))) this.draw(now);
    if (now - this.since >= LOOK_MS) this.look(now);
    if (frame) this.showForcesOf(frame);
    this.onTurn();
    if (moved || (this.stage.layout && this.changed && !this.rests)) this.request();
  }

  isTimeToDraw(now) {
    const { hz } = this.governor.step;
    return !hz || now - this.drawnAt >= 1000 / hz;
  }

  draw(now) {
    const timed = this.frames % TIMED_EVERY === 1;
    this.stage.draw();
    if (timed) {
      this.stage.finish();
      this.costs.push(performance.now() - now);
    }
    this.drawnAt = now;
    this.changed = false;
    if (document.body.dataset.face !== "engineer" || $("hands").classList.contains("taken")) this.placeTags();
  }

  // Each hand's name on its tool, and its figures on the half of the picture where the tool is.
  placeTags() {
    const frame = this.last;
    if (!frame || !this.rows) return;
    const box = $("view").getBoundingClientRect();
    this.rows.forEach(({ row }, i) => {
      const { port, jawLength } = this.stage.layout.tools[i], tag = $("tags").children[i];
      const place = jawsAt([...frame.poses.subarray(7 * i, 7 * i + 3)], port, 0.65 * jawLength), { x, y } = this.stage.pixelOf(place);
      const at = (x - box.left) / box.width, high = (y - box.top) / box.height, isAhead = this.stage.isAhead(place);
      const beside = Math.max(0, Math.min(x - box.left, box.width - tag.offsetWidth - tag.offsetLeft)); // whole, at the picture's edge
      const isUnder = this.covered.some(({ left, right, top, bottom }) => beside + box.left < right && beside + box.left + TAG_PX.width > left && y - TAG_PX.height < bottom && y > top);
      tag.hidden = isUnder || !(isAhead && at > 0 && at < 1 && high > 0 && high < 1);
      tag.style.transform = `translate(${beside.toFixed(0)}px, ${(y - box.top).toFixed(0)}px)`;
      if (Math.abs(at - 0.5) > 0.04 || !row.dataset.side) row.dataset.side = at < 0.5 === isAhead ? "left" : "right";
    });
  }

  // Returns the largest force on each tool since the last call, in N.
  takePeaks() {
    const peaks = this.peaks;
    this.peaks = [];
    return this.stage?.layout?.tools.map(({ name }, i) => ({ name, newton: peaks[i] ?? this.felt[i] ?? null })) ?? [];
  }

  // Returns where a tool's junction point is in the newest picture, in mm; null before the first.
  placeOf(i) {
    return this.last ? [...this.last.poses.subarray(7 * i, 7 * i + 3)] : null;
  }

  showForcesOf(frame) {
    const limit = this.attempt?.limit;
    this.rows?.forEach((row, i) => {
      const newton = Math.hypot(...frame.forces.subarray(3 * i, 3 * i + 3));
      this.felt[i] = newton;
      this.peaks[i] = Math.max(this.peaks[i] ?? 0, newton);
      row.limit.hidden = !limit;
      if (limit) row.limit.style.left = `${100 * Math.min(1, Math.sqrt(limit / FORCE_FULL_N))}%`;
      row.row.dataset.over = limit && newton > limit ? "yes" : "no";
      row.row.dataset.near = limit && newton > NEAR * limit && newton <= limit ? "yes" : "no";
      row.held.textContent = this.attempt?.held(i) ?? "";
      row.bar.style.transform = `scaleX(${Math.min(1, Math.sqrt(newton / FORCE_FULL_N))})`;
      row.bar.style.background = colourOfForce(newton);
      row.value.textContent = force(newton);
      row.jaw.textContent = this.stage.layout.tools[i].jawLength ? t("jaws {angle}°", { angle: Math.round((frame.jaws[i] * 180) / Math.PI) }) : "";
    });
  }

  // Once a second: figures, and whether to draw more or less finely.
  look(now) {
    const seconds = (now - this.since) / 1000, painted = this.frames / seconds;
    this.painted = this.isSeen() ? painted : -1;
    $("picture-hz").textContent = this.last ? `${painted.toFixed(0)} Hz` : "–";
    this.showFigures();
    const offered = (this.stream?.countCame() ?? 0) / seconds;
    const cost = this.costs.length ? this.costs.sort((a, b) => a - b)[this.costs.length >> 1] : null;
    Object.assign(this.canvas.dataset, { hz: painted.toFixed(1), cost: cost?.toFixed(1) ?? "", step: this.governor.at });
    const looked = document.visibilityState === "visible" && this.last && offered > 0;
    this.slow = looked && painted < this.governor.least(offered);
    if (looked && this.governor.look({ now: now / 1000, cost, offered, painted })) this.takeStep();
    this.scaleBar();
    this.covered = covering().map((each) => each.getBoundingClientRect()).filter(({ width }) => width);
    this.beginAnew();
  }

  // Whether pictures can come: the page is in front, and the rig has sent some.
  isSeen() {
    return document.visibilityState === "visible" && Boolean(this.last);
  }

  showFigures() {
    $("inserted").textContent = this.last ? `${this.last.inserted_mm.toFixed(1)} mm` : "–";
    $("tick").textContent = this.last ? `${(this.last.tick / 1000).toFixed(1)} s` : "–";
  }

  takeStep(at = this.governor.at) {
    this.governor.at = at;
    this.stream.want(this.governor.step.hz);
    this.showStep();
    this.askAgain(() => this.stage.setStep(this.governor.step)); // bodies made anew are where they begin
  }

  beginAnew() {
    this.frames = 0;
    this.costs = [];
    this.starting = "";
    this.stream?.countCame();
    this.since = performance.now();
  }

  showStep() {
    $("drawn-how").textContent = this.governor.words(this.software);
  }

  scaleBar() {
    if (!this.stage.layout) return;
    const perPixel = this.stage.mmPerPixel();
    const mm = SCALE_STEPS_MM.findLast((step) => step / perPixel <= 140) ?? SCALE_STEPS_MM[0];
    $("scale").style.width = `${mm / perPixel}px`;
    $("scale").textContent = `${mm} mm`;
  }
}

function toolRow(name) {
  const row = document.createElement("li");
  const label = Object.assign(document.createElement("span"), { textContent: t(name) });
  const track = document.createElement("b");
  track.append(document.createElement("i"), Object.assign(document.createElement("u"), { title: t("limit"), hidden: true }));
  row.append(label, track, document.createElement("output"), document.createElement("small"), document.createElement("em"));
  return row;
}

function toggle(button, apply) {
  const set = (on) => {
    button.setAttribute("aria-pressed", on);
    apply(on);
  };
  button.onclick = () => set(button.getAttribute("aria-pressed") !== "true");
  set(button.getAttribute("aria-pressed") === "true");
  return set;
}
