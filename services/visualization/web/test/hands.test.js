import assert from "node:assert/strict";
import { test } from "node:test";
import { Gamepads } from "../src/hands/gamepad.js";
import { Grip } from "../src/hands/grip.js";
import { Hands } from "../src/hands/hands.js";
import { atDepth, jawsAt, junctionAt, leashed, length, onLevel, onPicture, sub } from "../src/hands/motion.js";
import { Pointer } from "../src/hands/pointer.js";
import { loudnessOf, pitchOf } from "../src/hands/tone.js";

const near = (a, b, within = 1e-9) => a.forEach((x, i) => assert.ok(Math.abs(x - b[i]) < within, `${a} is not ${b}`));
const PORT = [75, -60, 120];
const SHAPE = { port: PORT, jawLength: 18 };

test("a pointer finds the level plane below the eye, and nothing at the horizon", () => {
  near(onLevel({ origin: [0, 0, 100], direction: [0.6, 0, -0.8] }, 20), [60, 0, 20]);
  assert.equal(onLevel({ origin: [0, 0, 100], direction: [1, 0, -0.05] }, 20), null);
  assert.equal(onLevel({ origin: [0, 0, 100], direction: [0, 0, 1] }, 20), null);
});

test("a pointer finds the plane of the picture through a point", () => {
  near(onPicture({ origin: [0, 0, 0], direction: [0.6, 0, 0.8] }, [5, 5, 8], [0, 0, 1]), [6, 0, 8]);
});

test("jaws and junction lie on one line with the port", () => {
  const jaws = [72, 1.5, 0], junction = junctionAt(jaws, PORT, 10);
  near([length(sub(jaws, junction))], [10]);
  near(jawsAt(junction, PORT, 10), jaws);
});

test("held depth lets a tool swing about its port only", () => {
  near([length(sub(atDepth([10, 20, 30], PORT, 100), PORT))], [100]);
  const grip = new Grip({ name: "left", position_m: [0.07, 0, 0.02], roll_rad: 0 }, SHAPE);
  grip.holdDepth(true);
  const depth = length(sub(grip.jaws, PORT));
  grip.move([5, -3, 8]);
  near([length(sub(grip.jaws, PORT))], [depth]);
});

// The hands of a person on a page whose elements are nothing but their attributes, with a grip on two tools.
function handsOnPage() {
  const elements = {};
  const element = () => {
    const attributes = { "aria-pressed": "false" };
    return { getAttribute: (name) => attributes[name], setAttribute: (name, value) => (attributes[name] = String(value)) };
  };
  globalThis.document = { getElementById: (id) => (elements[id] ??= element()) };
  globalThis.addEventListener = () => {};
  const hands = new Hands({ canvas: { addEventListener: () => {} } }, null);
  const tools = [{ name: "left", position_m: [0.07, 0, 0.02], roll_rad: 0 }, { name: "right", position_m: [0.02, 0.03, 0.01], roll_rad: 0 }];
  hands.grips = tools.map((tool, at) => Object.assign(new Grip(tool, SHAPE), { at }));
  return { hands, elements };
}

test("the other tool follows while that is switched on, by as much as the first really moved", () => {
  const { hands, elements } = handsOnPage();
  const [left, right] = hands.grips;
  const moved = (by) => {
    const before = hands.grips.map((grip) => grip.jaws);
    hands.move(left, by);
    return hands.grips.map((grip, i) => sub(grip.jaws, before[i]));
  };
  near(moved([5, -3, 8])[1], [0, 0, 0]);
  elements["hand-follow"].onclick();
  assert.equal(elements["hand-follow"].getAttribute("aria-pressed"), "true");
  for (const each of moved([5, -3, 8])) near(each, [5, -3, 8]);

  // A first tool that is blocked 20 mm back goes 5 mm on, to the end of its leash, and so does the other.
  const frame = new Float64Array(14);
  const at = [sub(left.jaws, [20, 0, 0]), right.jaws];
  hands.view.last = { poses: frame };
  for (const grip of hands.grips) grip.jawsOf = () => at[grip.at];
  for (const each of moved([15, 0, 0])) near(each, [5, 0, 0]);

  elements["hand-follow"].onclick();
  hands.view.last = null;
  near(moved([5, -3, 8])[1], [0, 0, 0]);
});

test("a tool without jaws is steered by its tip", () => {
  const grip = new Grip({ name: "probe", position_m: [0.07, 0, 0.02], roll_rad: 0 }, { port: PORT, jawLength: 0 });
  assert.equal(grip.hasJaws, false);
  for (const fingers of [false, true]) assert.doesNotMatch(grip.hint(fingers), /jaws|close/);
  near(grip.jaws, [70, 0, 20]);
  grip.move([5, -3, 8]);
  const [name, junction, , opening] = grip.row();
  assert.deepEqual([name, opening], ["probe", -1]);
  near(junction, [0.075, -0.003, 0.028]);
});

test("a blocked tool does not wind the hand up", () => {
  near(leashed([100, 0, 0], [0, 0, 0], 25), [25, 0, 0]);
  near(leashed([10, 0, 0], [0, 0, 0], 25), [10, 0, 0]);
});

test("a grip begins where its tool is, in the units of the wire", () => {
  const grip = new Grip({ name: "left", position_m: [0.07, -0.01, 0.02], roll_rad: 0.3 }, SHAPE);
  const [name, at, roll, opening] = grip.row();
  assert.deepEqual([name, roll, opening], ["left", 0.3, -1]);
  near(at, [0.07, -0.01, 0.02]);
  grip.move([10, 0, 0]);
  assert.ok(grip.row()[1][0] > 0.078);
});

test("who has fingers is told of no wheel", () => {
  const grip = new Grip({ name: "left", position_m: [0.07, 0, 0.02], roll_rad: 0 }, SHAPE);
  assert.match(grip.hint(false), /wheel.*click.*Tab/);
  assert.doesNotMatch(grip.hint(true), /wheel|click|Tab/);
});

// A canvas that keeps who listens, and what a pointer on it asks for.
function pointed() {
  const listeners = {}, asked = { lift: 0, turn: 0, drags: 0, clicks: 0 };
  const canvas = { addEventListener: (kind, listener) => (listeners[kind] = listener), setPointerCapture: () => {} };
  const pointer = new Pointer(canvas, {
    onDrag: () => asked.drags++, onLift: (mm) => (asked.lift += mm), onTurn: (rad) => (asked.turn += rad),
    onClick: () => asked.clicks++,
  });
  pointer.on = true;
  const at = (kind, pointerId, clientX, clientY) => listeners[kind]({ type: kind, button: 0, pointerId, clientX, clientY });
  return { asked, at };
}

test("a second finger raises, or turns if it sets off sideways, and closes nothing", () => {
  for (const [x, y, what] of [[0, -1, "lift"], [1, 0, "turn"]]) {
    const { asked, at } = pointed();
    at("pointerdown", 1, 100, 100);
    at("pointerdown", 2, 200, 100);
    for (let k = 1; k <= 40; k++) at("pointermove", 2, 200 + k * x, 100 + k * y);
    for (const finger of [2, 1]) at("pointerup", finger, 200, 100);
    assert.ok(asked[what] > 0);
    assert.equal(asked[what === "lift" ? "turn" : "lift"], 0);
    assert.deepEqual([asked.drags, asked.clicks], [0, 0]);
    at("pointerdown", 1, 100, 100);
    at("pointerup", 1, 100, 100);
    assert.equal(asked.clicks, 1);
  }
});

test("a gamepad's stick has a dead zone, and its triggers close", () => {
  const pad = { connected: true, mapping: "standard", axes: [0.05, -1, 0, 0], buttons: Array(16).fill({ value: 0 }) };
  const gamepads = new Gamepads();
  const resting = { ...pad, axes: [0.05, 0, 0, 0] };
  for (let now = 0; now <= 300; now += 16) gamepads.read(0.016, now, [null, resting]);
  pad.buttons[6] = { value: 0.5 };
  const [left, right] = gamepads.read(1, 320, [null, pad]);
  near(left.by, [0, 25, 0]);
  assert.equal(left.closing, 0.5);
  assert.deepEqual([left.roll, right.roll], [0, 0]);
  pad.buttons[15] = pad.buttons[2] = { value: 1 };
  const turned = gamepads.read(0.5, 336, [pad]).map((hand) => hand.roll);
  assert.deepEqual(turned, [0.6, -0.6]);
  near(right.by, [0, 0, 0]);
  assert.equal(gamepads.read(1, 352, [null]), null);
});

test("more force sounds higher and louder, none is silent", () => {
  assert.equal(loudnessOf(0), 0);
  assert.ok(loudnessOf(1) < loudnessOf(2) && pitchOf(1) < pitchOf(2));
  assert.equal(pitchOf(3), pitchOf(30));
});

test("a finger that has dragged does not say what two of them do", () => {
  const { asked, at } = pointed();
  at("pointerdown", 1, 100, 100);
  for (let k = 1; k <= 20; k++) at("pointermove", 1, 100 + 5 * k, 100);
  at("pointerdown", 2, 300, 100);
  for (let k = 1; k <= 20; k++) at("pointermove", 1, 200, 100 - k);
  assert.ok(asked.lift > 0);
  assert.equal(asked.turn, 0);
});
