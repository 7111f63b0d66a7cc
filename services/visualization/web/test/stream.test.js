import assert from "node:assert/strict";
import { test } from "node:test";
import { Silence } from "../src/dashboard/stream.js";

test("a supervisor that says nothing for three seconds is silent", () => {
  const silence = new Silence(0);
  for (let now = 500; now <= 3000; now += 500) assert.equal(silence.look(now), false);
  assert.equal(silence.look(3500), true);
  silence.heard(3600);
  assert.equal(silence.look(4100), false);
});

test("time in which the page itself was not run counts against nobody", () => {
  const silence = new Silence(0);
  assert.equal(silence.look(9000), false); // a browser that was held up while it loaded
  assert.equal(silence.look(13000), false);
  for (let now = 13500; now <= 15000; now += 500) assert.equal(silence.look(now), false);
  assert.equal(silence.look(15500), true);
});
