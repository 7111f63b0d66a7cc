"""The quality governor against the table of cases that its twin in the page is held to as well (node runs that)."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

from trocar import services
from trocar.services.runtime.loop.quality_governor import Hysteresis, Load, QualityGovernor

TABLE = Path(services.__file__).parent / "visualization" / "web" / "test" / "quality_governor.json"
CASES = json.loads(TABLE.read_text())


@pytest.mark.parametrize("case", CASES, ids=lambda case: case["case"])
def test_each_look_leads_to_the_level_and_the_wait_of_the_table(case: dict[str, Any]) -> None:
    hysteresis = Hysteresis(**{key: math.inf if value is None else value for key, value in case["hysteresis"].items()})
    governor = QualityGovernor(case["levels"], hysteresis, case["way"])
    for now_s, load, level, wait_s in case["looks"]:
        before = governor.level
        has_changed = governor.observe(now_s, Load(load))
        assert (governor.level, governor.wait_s) == (level, wait_s), f"after the look at {now_s} s"
        assert has_changed == (level != before)
