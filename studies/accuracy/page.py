"""The table as one page that needs nothing else: error against cost, every point clickable to its settings."""

from __future__ import annotations

import json
import math
from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from trocar.services.files.atomic_file import atomic_file
from trocar.services.messages.page_style import styled
from trocar.studies.accuracy.facts import Facts
from trocar.studies.accuracy.report import BUDGET_US
from trocar.studies.accuracy.study import Row

_TEMPLATE = Path(__file__).with_name("page.html")


@dataclass(frozen=True, slots=True)
class Text:
    """What a study says of itself and of its numbers."""

    title: str
    what: str
    findings: Sequence[str] = ()
    figure: str = ""
    """One of its own, as an address that holds it."""


def held_figure(svg: Path) -> str:
    """Return a figure as an address that holds it, so that a page needs no other file."""
    return "data:image/svg+xml;base64," + b64encode(svg.read_bytes()).decode("ascii")


def write_page(rows: Sequence[Row], texts: Mapping[str, Text], facts: Facts, path: Path) -> None:
    """Write the page; ``texts`` are by study."""
    data = {
        "rows": [_row(row) for row in rows],
        "studies": {name: asdict(text) for name, text in texts.items()},
        "budget_us": BUDGET_US,
        "facts": facts.lines(),
    }
    # "</" would end the script that holds it.
    told = json.dumps(data, allow_nan=False).replace("</", "<\\/")
    with atomic_file(path) as half:
        page = styled(_TEMPLATE.read_text(encoding="utf-8"))
        half.write_text(page.replace("/*DATA*/null", told), encoding="utf-8")


def _row(row: Row) -> dict[str, Any]:
    cost = None if row.cost is None else [row.cost.median_us, row.cost.p99_us, row.cost.noise_us]
    return {
        "study": row.study,
        "setting": row.setting,
        "series": row.series,
        "quantity": row.quantity,
        "error": row.error if math.isfinite(row.error) else None,
        "unit": row.unit,
        "known": row.is_known,
        "cost": cost,
        "choices": dict(row.choices),
    }
