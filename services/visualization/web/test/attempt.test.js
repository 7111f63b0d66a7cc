import assert from "node:assert/strict";
import { test } from "node:test";
import { faceOf } from "../src/attempt/faces.js";
import { commandFor, howToSee, momentOf } from "../src/attempt/replay.js";
import { clock, errorList, headline, holding, notCounted, paceWords, scoreWords } from "../src/attempt/words.js";

const attempt = { state: "running", outcome: "", pace: 1, reason: "", counts: true, why_not: "" };

test("a face is the address's, else the one chosen last, else the trainee's where a page has hands", () => {
  assert.equal(faceOf("#token=x&face=instructor", "engineer", true), "instructor");
  assert.equal(faceOf("#token=x", "engineer", true), "engineer");
  assert.equal(faceOf("#face=somebody", null, true), "trainee");
  assert.equal(faceOf("", "nonsense", false), "engineer");
});

test("every state of an attempt has words, and a mark that needs no colour", () => {
  const of = (more) => headline({ ...attempt, ...more });
  assert.equal(of({ state: "armed" }).words, "Begin when you like");
  assert.equal(of({ state: "armed", counts: false }).words, "Not ready");
  assert.equal(of({}).words, "Under way");
  assert.equal(of({ pace: 0.25 }).words, "Under way at 1/4 of the clock");
  assert.equal(of({ pace: 0 }).words, "Paused");
  assert.deepEqual(of({ state: "done", outcome: "success", reason: "10.2 mm" }), { mark: "✓", words: "Well done", more: "10.2 mm", kind: "success" });
  const marks = [of({ state: "armed" }), of({}), of({ pace: 0 }), of({ outcome: "success" }), of({ outcome: "failure" })];
  assert.equal(new Set(marks.map(({ mark }) => mark)).size, 5);
});

test("what does not count says why and no figures", () => {
  assert.equal(notCounted(attempt), "");
  assert.equal(notCounted({ counts: false, why_not: "the rig was late" }), "This attempt does not count: the rig was late.");
});

test("clock, pace and what is held are as people say them", () => {
  assert.deepEqual([0, 59.94, 60, 3599.9999999].map(clock), ["0:00", "0:59", "1:00", "60:00"]);
  assert.deepEqual([1, 0.5, 1 / 32, 0.3].map(paceWords), ["1", "1/2", "1/32", "0.30"]);
  assert.deepEqual(["catheter", "duct", ""].map(holding), ["holding the catheter", "holding the duct", "holding nothing"]);
});

test("errors are listed by number, with words and counts", () => {
  const list = errorList({ E10: 1, E2: 3, E5: 0 });
  assert.deepEqual(list.map(({ code, count }) => [code, count]), [["E2", 3], ["E10", 1]]);
  assert.deepEqual(errorList(undefined), []);
});

test("a score is told once there is one, with what was to be had", () => {
  assert.equal(scoreWords({ score: -1, time_limit_s: 300 }), "");
  assert.equal(scoreWords({ score: 0, time_limit_s: 300 }), "Score 0 of at most 300");
  assert.equal(scoreWords({ time_limit_s: 300 }), "");
});

test("an address names a moment of a recording, or none", () => {
  assert.deepEqual(momentOf("#replay=it's%20mine.mcap&at=7.50"), { file: "it's mine.mcap", at: 7.5 });
  assert.deepEqual(momentOf("#token=x&replay=a.mcap"), { file: "a.mcap", at: 0 });
  for (const hash of ["", "#at=3", "#replay=&at=3", "#replay=a&at=-1", "#replay=a&at=soon", "#replay=a&at=Infinity"]) {
    assert.equal(momentOf(hash), null, hash);
  }
});

test("a moment that is not shown here comes with the command that shows it, whatever its name", () => {
  assert.equal(commandFor({ file: "a.mcap", at: 3.25 }), "trocar replay 'a.mcap' --pictures --from 3.25");
  assert.equal(commandFor({ file: "it's; rm", at: 0 }), "trocar replay 'it'\\''s; rm' --pictures --from 0.00");
  assert.ok(howToSee({ file: "a.mcap", at: 3.25 }, "b.mcap").startsWith("This page shows b.mcap."));
});
