import assert from "node:assert/strict";
import { test } from "node:test";
import { viewAddress } from "../src/address.js";
import { busLoad, duration, force, givenUp, hz, losses, percent, share, startTold, us } from "../src/dashboard/format.js";

const page = (href) => new URL(href);

test("the view is found under the name of the page, through tunnels too", () => {
  assert.equal(viewAddress("ws://127.0.0.1:8081/ws", page("http://127.0.0.1:8080/")), "ws://127.0.0.1:8081/ws");
  assert.equal(viewAddress("ws://0.0.0.0:9000/ws", page("http://rig:8080/")), "ws://rig:9000/ws");
  assert.equal(viewAddress("ws://127.0.0.1:8081/ws", page("https://rig/")), "wss://rig:8081/ws");
  assert.equal(viewAddress("ws://other:8081/ws", page("http://rig:8080/")), "ws://other:8081/ws");
});

test("unknown figures are dashes, never NaN", () => {
  for (const format of [us, hz, share, percent, duration, force]) {
    for (const unknown of [null, undefined, NaN, Infinity, "1"]) assert.equal(format(unknown), "–");
  }
});

test("what was dropped or refused is told, and nothing else", () => {
  assert.equal(losses({ dropped_contacts: 3, refused_basis: 1, dropped_holds: 0, temperature: 4 }), "dropped contacts 3, refused basis 1");
  assert.equal(losses({ dropped_holds: 1, withheld_s: 2.5 }), "dropped holds 1, withheld 2.50 s");
  assert.equal(losses({ withheld_s: 0 }), "");
  assert.equal(losses(undefined), "");
  assert.equal(busLoad({ "bus_load.left.grasp": 0.231, "bus_load.right.grasp": 0.463, late: 1 }), "CAN 46 % full");
  assert.equal(busLoad({ late: 1 }), "");
});

test("figures are short and keep their meaning", () => {
  assert.equal(us(22.34), "22.3");
  assert.equal(us(1587.4), "1.59 ms");
  assert.equal(us(12345), "12.3 ms");
  assert.equal(us(123456), "123 ms");
  assert.equal(hz(999.7), "1000");
  assert.equal(hz(59.94), "59.9");
  assert.equal(share(0), "0");
  assert.equal(share(0.00002), "20 ppm");
  assert.equal(share(0.0013), "0.13 %");
  assert.equal(share(0.99731), "100 %");
  assert.equal(percent(0.99731), "99.73 %");
  assert.equal(percent(1), "100 %");
  assert.equal(force(0.0042), "4.2 mN");
  assert.equal(force(0.042), "42 mN");
  assert.equal(force(0.42), "0.42 N");
  assert.equal(duration(59), "59 s");
  assert.equal(duration(600), "10 min");
});

test("what was given up for time is told with what it costs in accuracy", () => {
  const quality = { name: "dry", rungs: 3, force_error_percent: 1.5, motion_error_percent: null };
  assert.equal(givenUp({ quality_level: 0, quality }), "");
  assert.equal(givenUp({ quality_level: 1, quality }), "quality level 1 of 2: dry, force off by 1.5 %");
  assert.equal(givenUp({ quality_level: 2 }), "quality level 2");
});

test("while the rig starts the slowest process is told, and why it takes long", () => {
  const processes = [{ name: "physics", start: ["contact: 37 kernels compiled", 0.434] }, { name: "gateway", start: ["devices open", 1] }, { name: "recorder", start: null }];
  const state = { state: "starting", start_notice: "first start: compiles for about a minute; later ones take seconds", processes };
  assert.equal(startTold(state), "First start: compiles for about a minute; later ones take seconds. physics 43 %, contact: 37 kernels compiled");
  assert.equal(startTold({ ...state, start_notice: "" }), "physics 43 %, contact: 37 kernels compiled");
  assert.equal(startTold({ state: "starting", processes: [] }), "The rig is starting");
  assert.equal(startTold({ ...state, state: "running" }), "");
});
