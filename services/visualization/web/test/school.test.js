// The school's words: each sentence can be said in German, numbers stay, mistakes have no codes.

import assert from "node:assert/strict";
import { readdirSync, readFileSync } from "node:fs";
import { test } from "node:test";
import { setLanguage, said, t } from "../src/school/i18n.js";
import { Keeper, packed, unpacked } from "../src/school/keeper.js";
import { cost, measured, MISTAKES, what } from "../src/school/sentences.js";
import { apart, inRows, steps, Track } from "../src/school/track.js";

const folders = ["school", "settings"].map((name) => new URL(`../src/${name}/`, import.meta.url));
const read = (place) => JSON.parse(readFileSync(place, "utf8"));
const answers = read(new URL("../../../messages/answers.de.json", import.meta.url));
const german = Object.assign({ ...answers }, ...folders.map((folder) => read(new URL("words.de.json", folder))));
const shown = ["school", "settings", "view", "attempt", "hands", "dashboard", "xr"].map((name) => new URL(`../src/${name}/`, import.meta.url));
const sources = shown.flatMap((folder) => readdirSync(folder).filter((each) => each.endsWith(".js")).map((name) => [name, readFileSync(new URL(name, folder), "utf8")]));

test("every sentence of the page that asks for it has a German one, with the same values", () => {
  for (const [name, source] of sources) {
    const keys = [...source.matchAll(/\bt\("((?:[^"\\]|\\.)*)"/g), ...source.matchAll(/(?:ask|what|how|follows|force|stop): "((?:[^"\\]|\\.)*)"/g)];
    for (const [, key] of keys) {
      assert.ok(german[key], `${name}: ${key}`);
      const values = (text) => [...text.matchAll(/\{\w+\}/g)].map(String).sort().join();
      assert.equal(values(german[key]), values(key), key);
    }
  }
});

// Texts of two words or more that a file of the page holds, in quotes or between backticks, without names of classes and selectors.
function sentencesOf(source) {
  const code = source.replace(/(^|\s)\/\/.*$/gm, "$1");
  const found = [...code.matchAll(/(className(?::| =) )?"((?:[^"\\\n]|\\.)*)"|`((?:[^`\\]|\\.)*)`/g)].map(([, isClass, quoted, template]) => (isClass ? "" : quoted ?? template.replace(/\$\{[^}]*\}/g, " # ")));
  return found.filter((text) => /[A-Za-z“]{2,}[,;:.]? [a-z]+/.test(text) && !/[#.[:]\w+[ ,>)\]]|\)\s|^on |^action |^\(/.test(text.replace(/#token=…/g, "")));
}

test("every text of two words or more is one that has a German one, whoever shows it", () => {
  const engineers = ["dashboard.js", "tables.js", "format.js", "stream.js", "charts.js", "heat.js", "replay.js"]; // of the dashboard, and a command for a shell
  const main = ["main.js", "command.js"].map((name) => [name, readFileSync(new URL(`../src/${name}`, import.meta.url), "utf8")]);
  const found = [...sources, ...main].filter(([name]) => !engineers.includes(name)).flatMap(([name, source]) => sentencesOf(source).map((text) => [name, text]));
  assert.ok(found.length > 150, `${found.length}`);
  assert.deepEqual(found.filter(([, text]) => !german[text]).map(String), []);
  assert.deepEqual(sentencesOf('say("nobody has said this yet"); // but not this one\n go(`this of ${n} neither`)'), ["nobody has said this yet", "this of  #  neither"]);
});

// Figures, names, and what is the same in both languages.
const SAME = /^[^a-z]*(?:ms|mm|s|N|Hz|Trocar|p\d+(?:\.\d)?|max)?[^a-z]*$|^(?:English|Deutsch|trocar|Tab|Escape)$/;

test("the document has no text, title or label without a German one", () => {
  const body = readFileSync(new URL("../src/index.html", import.meta.url), "utf8").replace(/^[^]*<body/, "<body").replace(/<script[^]*?<\/script>/g, "");
  const texts = [...body.matchAll(/>([^<>]+)</g), ...body.matchAll(/(?:title|aria-label|placeholder)="([^"]+)"/g)].map(([, words]) => words.trim());
  assert.ok(texts.length > 100);
  assert.deepEqual(texts.filter((words) => words && !german[words] && !SAME.test(words)), []);
});

test("what the rig says keeps its numbers in another language", () => {
  setLanguage("de");
  assert.equal(said("Push on: 6 mm to go."), "Weiter: noch 6 mm.");
  assert.equal(said("10.2 mm deep after 23.8 s"), "10.2 mm tief nach 23.8 s");
  assert.equal(said("nobody has translated this 3"), "nobody has translated this 3");
  assert.equal(said("gateway: left: arm 1 has lost its calibration; right: the gripper is being opened anew"), "Gateway: links: Arm 1 hat seine Kalibrierung verloren; rechts: der Greifer wird neu geöffnet");
  assert.equal(said("give each instrument the name of its own arm: `settings: {name: ...}`"), "geben Sie jedem Instrument den Namen seines eigenen Arms: `settings: {name: ...}`");
  assert.equal(said("1 lines (2) were *not* read"), "1 lines (2) were *not* read");
  assert.equal(t("{n} tasks", { n: 4 }), "4 Aufgaben");
  setLanguage("en");
  assert.equal(said("Push on: 6 mm to go."), "Push on: 6 mm to go.");
});

test("a mistake is a sentence without a code, with its price", () => {
  for (const code of Object.keys(MISTAKES)) assert.ok(!/E\d/.test(what(code)), code);
  assert.equal(cost({ code: "E8", worst: 3.4, limit: 3, unit: "N", points: 20 }), "You crushed or kinked the catheter (3.4 N, at most 3 N): 20 points.");
  assert.equal(cost({ code: "E14", worst: 0, limit: 0.01, unit: "N", points: 0.2 }), "Nobody steadies the duct (0 N, at least 0.010 N): no points.");
  assert.equal(measured(0.004, "m"), "4 mm");
});

test("a replay comes back as it was kept", async () => {
  const frames = [1, 2, 3].map((n) => new Uint8Array([n, n, n]).buffer);
  const found = await unpacked(await packed('{"type":"hello"}', frames));
  assert.deepEqual(found.hello, { type: "hello" });
  assert.deepEqual(found.frames.map((each) => [...new Uint8Array(each)]), [[1, 1, 1], [2, 2, 2], [3, 3, 3]]);
});

test("with the pictures of an attempt it is kept from where they were seen, and a replay finds it", async () => {
  const sent = [], keeper = new Keeper({ ask: async (_, { body }) => sent.push(body) });
  const eyes = ["a", "a", "b", "b", null];
  keeper.setHello('{"type":"hello"}');
  await keeper.follow({ state: "running", attempt_id: "one" });
  for (const [i, eye] of eyes.entries()) {
    keeper.eye = () => eye;
    keeper.see(new Uint8Array([i]).buffer, 1000 * (i + 1));
  }
  await keeper.follow({ state: "done", attempt_id: "one" });
  const { hello, frames } = await unpacked(sent[0]);
  assert.equal(frames.length, eyes.length);
  const track = new Track(null, eyes.map((_, i) => ({ tick: 1000 * i })), 0, hello.seen);
  assert.deepEqual([0, 1, 2, 3, 4].map((second) => track.eyeAt(second)), ["a", "a", "b", "b", "b"]);
  assert.equal(new Track(null, [{ tick: 0 }], 0).eyeAt(0), null);
});

test("a second of an attempt is found by the rig's ticks, and what came before it is before zero", () => {
  const track = new Track(null, [900, 1000, 1500, 2000].map((tick) => ({ tick })), 1000);
  assert.deepEqual(track.times.map((each) => Math.round(10 * each) / 10), [-0.1, 0, 0.5, 1]);
  assert.equal(track.at(0.49).tick, 1000);
  assert.equal(track.at(0.5).tick, 1500);
  assert.equal(track.at(99).tick, 2000);
  assert.equal(track.at(-5).tick, 900);
});

// What a file shows that is no text of its own, and must be translated where it is shown.
const SHOWN = /(?:textContent|placeholder|title): (`[^`]*`|[^,})]+)|setAttribute\("(?:aria-label|title)", ([^;]+)\);|\btext\([\w.]+, (`[^`]*`|[^;]+)\);/g;

test("everything shown on the settings' devices passes through a translation", () => {
  for (const name of ["devices.js", "felt.js"]) {
    const source = readFileSync(new URL(`../src/settings/${name}`, import.meta.url), "utf8");
    for (const [whole, ...parts] of source.matchAll(SHOWN)) {
      const value = parts.find(Boolean);
      assert.ok(/\b(?:t|said|toldOf)\(/.test(value) || /^(?:words|steps\[done\]\.ask)$/.test(value.trim()), `${name}: ${whole}`);
    }
  }
});

test("an axis has a few round numbers, and whole ones where only those mean anything", () => {
  const near = (found, wanted) => assert.ok(found.length === wanted.length && found.every((each, i) => Math.abs(each - wanted[i]) < 1e-9), `${found}`);
  near(steps(0, 293, 3), [0, 100, 200]);
  near(steps(-0.4, 1.7, 3), [0, 1]);
  near(steps(0, 0.034, 3), [0, 0.02]);
  near(steps(1, 2, 6, true), [1, 2]);
  near(steps(1, 31, 6, true), [5, 10, 15, 20, 25, 30]);
});

test("words beside lines of a chart lie in short rows, none on another, and none below the chart", () => {
  assert.deepEqual(inRows("goal"), ["goal"]);
  assert.deepEqual(inRows("not acceptable above"), ["not acceptable", "above"]);
  const lines = [{ y: 10, rows: ["a", "b"] }, { y: 12, rows: ["c"] }, { y: 95, rows: ["d", "e"] }];
  const placed = apart(lines, (y) => y, 100, 12).map(({ y }) => y);
  for (const [i, y] of placed.entries()) assert.ok(i === 0 || y - placed[i - 1] >= 12 - 1e-9, `${placed}`);
  assert.ok(placed.at(-1) <= 100);
});
