"""The terminal's dashboard fits a terminal."""

from __future__ import annotations

import io
from typing import Any

from rich.console import Console

import protocol
from services.cli.top import render

LONG = {"p50": 99_999.0, "p99": 123_456.0, "p99_9": 234_567.0, "max": 345_678.0}


def _process(name: str) -> dict[str, Any]:
    loop = {"rate_hz": 1000.0, "target_hz": 1000.0, "lateness_us": LONG, "work_us": LONG, "miss_ratio": 1.0}
    return {"name": name, "state": "degraded", "pid": 99_999, "restarts": 12, "detail": "", "loop": loop}


def test_every_row_is_a_line_of_eighty_columns() -> None:
    topic = {"topic": "supervisor.health", "rate_hz": 1000.0, "target_hz": 1000.0, "drops": 30_648, "refused": {"a": 1}}
    result = {
        "state": "running", "reason": "", "quality_level": 0,
        "processes": [_process(name) for name in protocol.PROCESSES],
        "paths": dict.fromkeys(("device_model", "device_force", "device_pixel"), LONG),
        "topics": [{**topic, "topic": name, "age_us": LONG} for name in protocol.TOPICS],
    }  # fmt: skip
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(render(result))
    lines = console.export_text().splitlines()
    assert len(lines) == 2 + (1 + len(protocol.PROCESSES)) + (1 + 3) + (1 + len(protocol.TOPICS)), "no row is wrapped"
    assert max(map(len, lines)) <= 80
    assert not any("\u2026" in line for line in lines), "nothing is cut"
