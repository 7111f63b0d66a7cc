"""The model of an axis against the table that also holds the page's."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from trocar import services
from trocar.services.gateway.hands.input_axis import Axis

TABLE = Path(services.__file__).parent / "visualization" / "web" / "test" / "axis.json"
CASES = json.loads(TABLE.read_text())


@pytest.mark.parametrize("case", CASES, ids=[case["case"] for case in CASES])
def test_an_axis_is_that_of_the_table(case: Any) -> None:
    axis = Axis(case["low"], case["high"], case["first"])
    for now_ms, raw, stick, trigger in case["looks"]:
        if raw is not None:
            axis.report(raw, now_ms * 1_000_000)
        axis.advance(now_ms * 1_000_000)
        assert (axis.stick(), axis.trigger()) == (pytest.approx(stick, abs=1e-6), pytest.approx(trigger, abs=1e-6))
