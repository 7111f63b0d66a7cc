// The page of `trocar anatomy --edit`: the duct as it lies in the patient, seen from the front; the mouse picks.

import * as THREE from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";

import { nearestEnd, onLine, Picks } from "./picks.js";

const COLOURS = { mouth: "#2c9a52", held: "#d0443a", free: "#8a8a8a", port: "#4f7fc4", goal: "#d98a1a" };
const CLICK_PX = 4; // a mouse that moved further was turning the duct
const CATHETER_MM = 40;

const $ = (id) => document.getElementById(id);
const token = new URLSearchParams(location.search).get("token") ?? "";
const tool = () => document.querySelector('input[name="tool"]:checked').value;

async function ask(path, options) {
  const answer = await fetch(`api/${path}?token=${encodeURIComponent(token)}`, options);
  const told = await answer.json().catch(() => ({ refused: answer.statusText }));
  if (!answer.ok) throw new Error(told.refused ?? answer.statusText);
  return told;
}

function say(text, refused = false) {
  $("said").textContent = text;
  $("said").className = refused ? "refused" : "";
}

const DARK = "#050303", LIGHT = "#e9edf1"; // behind the duct: as the other pages' grounds

class Stage {
  constructor(canvas) {
    this.canvas = canvas;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true });
    this.scene = new THREE.Scene();
    const isDark = matchMedia("(prefers-color-scheme: dark)"), paint = () => (this.scene.background = new THREE.Color(isDark.matches ? DARK : LIGHT));
    isDark.addEventListener("change", () => {
      paint();
      this.draw();
    });
    paint();
    this.camera = new THREE.PerspectiveCamera(30, 1, 1, 5000);
    this.camera.up.set(0, 0, 1); // the head
    this.scene.add(new THREE.HemisphereLight("#ffffff", "#998877", 2.2));
    this.lamp = new THREE.DirectionalLight("#ffffff", 1.5);
    this.scene.add(this.lamp);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.addEventListener("change", () => this.draw());
    this.marks = new THREE.Group();
    this.scene.add(this.marks);
    new ResizeObserver(() => this.draw()).observe(canvas);
  }

  setDuct(duct) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.Float32BufferAttribute(duct.vertices_mm, 3));
    geometry.setIndex(duct.triangles);
    geometry.computeVertexNormals();
    const material = new THREE.MeshStandardMaterial({
      color: "#d9a08f", roughness: 0.6, side: THREE.DoubleSide, transparent: true, opacity: 0.85,
    });
    this.wall = new THREE.Mesh(geometry, material);
    this.scene.add(this.wall);
    for (const line of duct.lines_mm) this.scene.add(segment(line, "#5f6b76"));
    geometry.computeBoundingSphere();
    const { center, radius } = geometry.boundingSphere;
    this.radius = radius;
    this.controls.target.copy(center);
    this.camera.position.copy(center).add(new THREE.Vector3(0, -5.5 * radius, 0)); // from the front
    this.controls.update();
    this.draw();
  }

  draw() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    this.renderer.setPixelRatio(devicePixelRatio);
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / Math.max(1, height);
    this.camera.updateProjectionMatrix();
    this.lamp.position.copy(this.camera.position);
    this.renderer.render(this.scene, this.camera);
  }

  ray(event) {
    const box = this.canvas.getBoundingClientRect();
    const at = new THREE.Vector2(
      (2 * (event.clientX - box.left)) / box.width - 1, 1 - (2 * (event.clientY - box.top)) / box.height,
    );
    const caster = new THREE.Raycaster();
    caster.setFromCamera(at, this.camera);
    return caster;
  }

  // The place on the duct, or on the disc of an end, under the mouse; null beside it.
  onDuct(event, ends) {
    const caster = this.ray(event), hits = caster.intersectObject(this.wall);
    for (const end of ends) {
      const middle = new THREE.Vector3(...end.at_mm), out = new THREE.Vector3(...end.out);
      const point = caster.ray.intersectPlane(new THREE.Plane().setFromNormalAndCoplanarPoint(out, middle), new THREE.Vector3());
      if (point && point.distanceTo(middle) < 0.6 * end.width_mm) hits.push({ point, distance: caster.ray.origin.distanceTo(point) });
    }
    hits.sort((a, b) => a.distance - b.distance);
    return hits.length ? hits[0].point.toArray() : null;
  }

  // The place under the mouse in the plane through a place that faces the camera.
  facing(event, place) {
    const normal = this.camera.getWorldDirection(new THREE.Vector3());
    const plane = new THREE.Plane().setFromNormalAndCoplanarPoint(normal, new THREE.Vector3(...place));
    return this.ray(event).ray.intersectPlane(plane, new THREE.Vector3())?.toArray() ?? null;
  }
}

function segment(points, colour, close = false) {
  const vertices = (close ? [...points, points[0]] : points).map((p) => new THREE.Vector3(...p));
  const geometry = new THREE.BufferGeometry().setFromPoints(vertices);
  return new THREE.Line(geometry, new THREE.LineBasicMaterial({ color: colour }));
}

function ball(place, radius, colour) {
  const mesh = new THREE.Mesh(new THREE.SphereGeometry(radius, 16, 12), new THREE.MeshBasicMaterial({ color: colour }));
  mesh.position.set(...place);
  return mesh;
}

class Page {
  constructor() {
    this.stage = new Stage($("duct"));
    this.stage.canvas.addEventListener("pointerdown", (event) => (this.down = [event.clientX, event.clientY]));
    this.stage.canvas.addEventListener("pointerup", (event) => this.pick(event));
    $("save").onclick = () => this.save();
    $("propose").onclick = () => this.propose();
    $("end").onclick = () => ask("end", { method: "POST" }).then(() => say("Ended; this page can be closed."), refuse);
  }

  take(duct, isNew) {
    this.duct = duct;
    this.picks = new Picks(duct);
    $("file").textContent = duct.file;
    if (isNew) this.stage.setDuct(duct);
    this.show();
  }

  pick(event) {
    const moved = Math.hypot(event.clientX - this.down[0], event.clientY - this.down[1]);
    if (moved > CLICK_PX || event.button !== 0 || !this.picks) return;
    const what = tool();
    if (what.startsWith("port")) {
      const k = Number(what.slice(4)), place = this.stage.facing(event, this.picks.ports[k]);
      if (place) this.picks.setPort(k, place);
    } else if (what !== "look") this.pickOnDuct(what, this.stage.onDuct(event, this.picks.ends));
    this.show();
  }

  pickOnDuct(what, place) {
    if (!place) return;
    if (what === "goal") {
      this.picks.goal = onLine(this.duct.lines_mm, place);
      return;
    }
    const end = nearestEnd(this.picks.ends, place);
    if (!end) return say("Click nearer to an open end.", true);
    if (what === "mouth") this.picks.setMouth(end.name);
    else this.picks.toggleHeld(end.name);
  }

  show() {
    const { marks } = this.stage, { picks } = this;
    marks.clear();
    for (const end of picks.ends) {
      const kind = picks.kind(end.name), colour = COLOURS[kind];
      marks.add(segment(end.rim_mm, colour, true), ball(end.at_mm, 0.18 * end.width_mm, colour));
      if (kind === "mouth") {
        const at = (mm) => end.at_mm.map((x, k) => x + mm * end.out[k]);
        marks.add(segment([at(6), at(6 + CATHETER_MM)], "#1f4e9c"));
      }
    }
    picks.ports.forEach((port) => marks.add(ball(port, 0.05 * this.stage.radius, COLOURS.port)));
    if (picks.goal) marks.add(ball(picks.goal, 0.06 * this.stage.radius, COLOURS.goal));
    this.showTable();
    this.stage.draw();
  }

  showTable() {
    $("ends").replaceChildren(...this.picks.ends.map((end) => {
      const row = document.createElement("tr"), name = document.createElement("input");
      name.value = end.newName;
      name.setAttribute("aria-label", `name of ${end.name}`);
      name.onchange = () => (end.newName = name.value.trim());
      const kind = this.picks.kind(end.name);
      for (const content of [name, kind, `${end.width_mm} mm`]) {
        const cell = document.createElement("td");
        cell.append(content);
        row.append(cell);
      }
      row.style.setProperty("--mark", COLOURS[kind]);
      return row;
    }));
    const { goal } = this.duct;
    $("goal").textContent = goal ? `Goal: ${goal.depth_mm} mm from the mouth towards ${goal.end}.` : "";
  }

  propose() {
    this.picks.proposePorts();
    return this.save();
  }

  async save() {
    const fault = this.picks.fault();
    if (fault) return say(fault, true);
    say("Saving…");
    try {
      this.take(await ask("save", { method: "POST", body: JSON.stringify(this.picks.body()) }), false);
      say("Saved.");
    } catch (error) {
      refuse(error);
    }
  }
}

function refuse(error) {
  say(error.message, true);
}

const page = new Page();
globalThis.trocar = page; // for whoever looks into the page with the browser's tools
ask("duct").then((duct) => page.take(duct, true), refuse);
