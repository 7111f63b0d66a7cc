// The view: stream, stage, and the figures drawn over them.

import { force } from "../dashboard/format.js";
import { drawsInSoftware, Stage } from "./stage.js";
import { ViewStream } from "./stream.js";

const FORCE_FULL_N = 3;
const SCALE_STEPS_MM = [1, 2, 5, 10, 20, 50, 100];
const SLOW_HZ = 24;

const $ = (id) => document.getElementById(id);

export function colourOfForce(newton) {
  return newton < 1 ? "#67d1bd" : newton < 2 ? "#eab54d" : "#f0695a";
}

export class View {
  constructor() {
    this.canvas = $("scene");
    this.frames = 0;
    this.drawn = 0;
    this.since = performance.now();
    try {
      this.stage = new Stage(this.canvas, drawsInSoftware());
    } catch (error) {
      this.say(`This browser cannot draw in 3-D (${error.message}). The dashboard works all the same.`);
      return;
    }
    new ResizeObserver(() => this.resize()).observe($("view"));
    this.resize();
    this.bindButtons();
    this.say("Waiting for the view…");
    requestAnimationFrame(() => this.animate());
  }

  connect(address) {
    if (!this.stage || this.stream) return;
    this.stream = new ViewStream(address, {
      onLayout: (layout) => this.setLayout(layout),
      onRig: (rig) => this.setRig(rig),
      onLink: (text) => this.say(text ?? ""),
    });
  }

  say(text) {
    $("view-message").textContent = text;
    $("view-message").hidden = !text;
  }

  setLayout(layout) {
    this.stage.setLayout(layout);
    $("view").classList.add("ready");
    $("tools").replaceChildren(...layout.tools.map((tool) => toolRow(tool.name)));
    this.rows = [...$("tools").children].map((row) => ({
      bar: row.querySelector("i"), value: row.querySelector("output"), jaw: row.querySelector("small"),
    }));
  }

  setRig(rig) {
    $("rig-badge").textContent = rig.safe_stop ? "SAFE STOP" : rig.state.replace("_", " ").toUpperCase();
    $("rig-badge").dataset.state = rig.safe_stop ? "safe_stop" : rig.state;
    $("rig-badge").title = rig.reason;
  }

  bindButtons() {
    for (const button of document.querySelectorAll("[data-preset]")) {
      button.onclick = () => this.stage.layout && this.stage.lookFrom(button.dataset.preset);
    }
    toggle($("mirror"), (on) => {
      $("view").classList.toggle("mirrored", on);
      this.stage.mirrored = on;
    });
    toggle($("vignette"), (on) => $("view").classList.toggle("scope", on));
    toggle($("forces"), (on) => (this.stage.showForces = on));
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = $("view");
    if (width && height) this.stage.resize(width, height);
  }

  animate() {
    requestAnimationFrame(() => this.animate());
    const frame = this.stream?.take();
    if (frame) {
      this.stage.update(frame, colourOfForce);
      this.stream.painted(frame);
      this.frames++;
      this.last = frame;
    }
    if (this.stage.layout) this.stage.draw();
    this.drawn++;
    const now = performance.now();
    if (now - this.since >= 500) this.figures(now);
    if (frame) this.showForcesOf(frame);
  }

  showForcesOf(frame) {
    this.rows?.forEach((row, i) => {
      const newton = Math.hypot(...frame.forces.subarray(3 * i, 3 * i + 3));
      row.bar.style.transform = `scaleX(${Math.min(1, Math.sqrt(newton / FORCE_FULL_N))})`;
      row.bar.style.background = colourOfForce(newton);
      row.value.textContent = force(newton);
      row.jaw.textContent = `${Math.round((frame.jaws[i] * 180) / Math.PI)}°`;
    });
  }

  figures(now) {
    const seconds = (now - this.since) / 1000;
    const hz = this.frames / seconds;
    $("picture-hz").textContent = this.last ? `${hz.toFixed(0)} Hz` : "–";
    $("inserted").textContent = this.last ? `${this.last.inserted_mm.toFixed(1)} mm` : "–";
    $("tick").textContent = this.last ? `${(this.last.tick / 1000).toFixed(1)} s` : "–";
    if (document.visibilityState === "visible" && this.last && this.drawn / seconds < SLOW_HZ) this.stage.coarsen();
    this.scaleBar();
    this.frames = this.drawn = 0;
    this.since = now;
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
  const label = Object.assign(document.createElement("span"), { textContent: name });
  const track = document.createElement("b");
  track.append(document.createElement("i"));
  row.append(label, track, document.createElement("output"), document.createElement("small"));
  return row;
}

function toggle(button, apply) {
  const set = (on) => {
    button.setAttribute("aria-pressed", on);
    apply(on);
  };
  button.onclick = () => set(button.getAttribute("aria-pressed") !== "true");
  set(button.getAttribute("aria-pressed") === "true");
}
