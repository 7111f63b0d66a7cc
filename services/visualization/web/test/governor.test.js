import assert from "node:assert/strict";
import { test } from "node:test";
import { Governor, ladder, weight } from "../src/view/governor.js";

// A computer that takes so many milliseconds for a picture at full resolution with plain materials, and `fixed` for any.
function computer(software, cost, { fixed = 1, made = 36 } = {}) {
  const governor = new Governor(ladder(software, 1), software);
  const steps = [];
  let now = 0;
  const run = (seconds, ms = cost) => {
    for (let i = 0; i < seconds; i++) {
      const { hz } = governor.step;
      const took = fixed + ms * weight(governor.step), offered = Math.min(made, hz ?? Infinity);
      now++;
      governor.look({ now, cost: took, offered, painted: Math.min(offered, 1000 / took) });
      steps.push(governor.at);
    }
    return governor;
  };
  const changes = () => steps.filter((at, i) => i && at !== steps[i - 1]).length;
  return { governor, run, changes };
}

test("a fast computer draws everything as it is meant to be, and says nothing", () => {
  const { governor, run, changes } = computer(false, 1);
  run(120);
  assert.equal(governor.at, 0);
  assert.equal(changes(), 0);
  assert.equal(governor.words(false), "");
});

test("a slow one goes down step by step until it holds 30 pictures a second, and stays there", () => {
  const { governor, run, changes } = computer(false, 30);
  run(60);
  const { ratio, look, hz } = governor.step;
  assert.ok(look === "plain" && hz === null);
  assert.ok(1 + 30 * ratio * ratio < 1000 / 30);
  const before = changes();
  run(600);
  assert.ok(changes() - before <= 2, "it flaps");
  assert.match(governor.words(false), /^This computer draws slowly: .*plain materials/);
});

test("in software at least twelve are held where it can be, and fewer asked for than are made", () => {
  for (const cost of [5, 40, 150, 400]) {
    const { governor, run } = computer(true, cost);
    run(60);
    const { hz } = governor.step, took = 1 + cost * weight(governor.step);
    assert.ok(hz > 15 && hz <= 20, "who asks for few has fewer whenever one is late");
    assert.ok(Math.min(hz, 1000 / took) >= 0.99 * 12, `${cost}`);
    assert.match(governor.words(true), /on the processor: .*pictures a second asked for/);
  }
});

test("under load less is drawn, and all of it again when there is room", () => {
  const { governor, run } = computer(true, 20);
  run(60);
  const calm = governor.at;
  run(20, 400);
  const loaded = governor.at;
  assert.ok(weight(governor.steps[loaded]) < weight(governor.steps[calm]));
  run(300);
  assert.equal(governor.at, calm);
});

test("what is just not held is tried ever less often", () => {
  const { governor, run, changes } = computer(true, 1);
  run(20);
  // Whatever the estimate says, one step finer is not held.
  const floor = governor.at + 2;
  let now = 1000, tried = [];
  governor.at = floor;
  for (let i = 0; i < 600; i++) {
    now++;
    const held = governor.at >= floor;
    const before = governor.at;
    governor.look({ now, cost: 1, offered: 15, painted: held ? 15 : 3 });
    if (governor.at < before) tried.push(now);
  }
  assert.ok(tried.length >= 2 && tried.length <= 8, `${tried}`);
  const gaps = tried.slice(1).map((at, i) => at - tried[i]);
  assert.ok(gaps.every((gap, i) => i === 0 || gap >= gaps[i - 1]), `${gaps}`);
});

test("a rig that sends little is no reason to draw coarsely, and an unknown cost none to draw finely", () => {
  const { governor, run } = computer(false, 4, { made: 8 });
  run(60);
  assert.equal(governor.at, 0);
  const unknown = new Governor(ladder(true, 1), true);
  const began = unknown.at;
  for (let now = 0; now < 300; now++) unknown.look({ now, cost: null, offered: 15, painted: 15 });
  assert.equal(unknown.at, began);
});

test("a screen of few pixels has no two steps that are the same", () => {
  for (const dpr of [1, 1.5, 3]) {
    for (const software of [true, false]) {
      const steps = ladder(software, dpr).map((step) => JSON.stringify(step));
      assert.equal(new Set(steps).size, steps.length);
      assert.ok(ladder(software, dpr).every(({ ratio }) => ratio <= dpr));
    }
  }
});
