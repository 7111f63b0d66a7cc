import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";
import { QualityGovernor } from "../src/view/quality_governor.js";

// The same table holds services/runtime/loop/quality_governor.py: tests/runtime/loop/test_quality_governor.py.
const cases = JSON.parse(readFileSync(new URL("quality_governor.json", import.meta.url)));

for (const { case: name, levels, way, hysteresis, looks } of cases) {
  test(name, () => {
    const governor = new QualityGovernor(levels, { ...hysteresis, trial_s: hysteresis.trial_s ?? Infinity }, way);
    for (const [now, load, level, wait] of looks) {
      const before = governor.level;
      const hasChanged = governor.observe(now, load);
      assert.deepEqual([governor.level, governor.wait], [level, wait], `after the look at ${now} s`);
      assert.equal(hasChanged, level !== before);
    }
  });
}
