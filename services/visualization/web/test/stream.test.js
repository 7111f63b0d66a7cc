import assert from "node:assert/strict";
import { test } from "node:test";
import { RigStream, Silence } from "../src/dashboard/stream.js";
import { ViewStream } from "../src/view/stream.js";

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

// What a page does first: who is asked for what, in order.
async function begun(t, rig) {
  const done = [];
  t.mock.timers.enable({ apis: ["setInterval"] });
  globalThis.EventSource = class { constructor(address) { done.push(address); } addEventListener() {} };
  globalThis.fetch = async (address) => (done.push(address), { ok: true, json: async () => ({ name: "asked" }) });
  new RigStream({ onRig: ({ name }) => done.push(name) }, rig);
  const atOnce = done.length;
  await new Promise(setImmediate);
  return { done, atOnce };
}

test("a page that was served with its rig asks nobody who that is, and begins in the same turn", async (t) => {
  const { done, atOnce } = await begun(t, { name: "told" });
  assert.deepEqual(done, ["events", "told"]);
  assert.equal(atOnce, 2);
});

test("a page that was not asks first", async (t) => {
  assert.deepEqual((await begun(t, null)).done, ["api/rig", "events", "asked"]);
});

// A view's stream while each of its tries fails; `found` are the answers to where the view is, in order. Returns the
// addresses that were tried.
async function tried(t, found, nTries) {
  const addresses = [];
  t.mock.timers.enable({ apis: ["setTimeout"] });
  globalThis.WebSocket = class {
    static OPEN = 1;
    constructor(address) {
      addresses.push(address);
      queueMicrotask(() => this.onclose());
    }
  };
  const stream = new ViewStream("ws://rig:0/ws", async () => found.shift() ?? null);
  stream.handlers = { onLink() {} };
  while (addresses.length < nTries) {
    await new Promise(setImmediate);
    t.mock.timers.tick(2000);
  }
  stream.ended = true;
  stream.afterPaint.port1.close(); // else it keeps the test from ending
  return addresses;
}

test("a view that took any free port is asked for each time it is not reached", async (t) => {
  assert.deepEqual(await tried(t, ["ws://rig:0/ws", "ws://rig:9000/ws", "ws://rig:9001/ws"], 4),
    ["ws://rig:0/ws", "ws://rig:0/ws", "ws://rig:9000/ws", "ws://rig:9001/ws"]);
});

test("where nobody says where the view is, the last address is tried again", async (t) => {
  assert.deepEqual(await tried(t, ["ws://rig:9000/ws", null], 3), ["ws://rig:0/ws", "ws://rig:9000/ws", "ws://rig:9000/ws"]);
});
