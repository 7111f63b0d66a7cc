"""Studies as they stand beside a page of the documentation, one file each: the page is made anew in parts."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from trocar.services.files.atomic_file import atomic_file
from trocar.studies.accuracy.facts import Facts
from trocar.studies.accuracy.study import Cost, Row


@dataclass(frozen=True, slots=True)
class Section:
    """One study of a page: its rows, and what they were made with, as lines for a reader."""

    rows: tuple[Row, ...]
    made_with: tuple[str, ...]


def write_section(rows: Sequence[Row], facts: Facts, path: Path) -> None:
    """Write the rows of one study, an error to its last digit, a row a line."""
    told = ",\n".join(json.dumps(asdict(row)) for row in rows)
    with atomic_file(path) as half:
        half.write_text(f'{{"made_with": {json.dumps(facts.lines())}, "rows": [\n{told}\n]}}\n', encoding="utf-8")


def read_section(path: Path) -> Section:
    """Read them again. Raises ValueError if the file holds something else."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        rows = tuple(_row(each) for each in data["rows"])
        return Section(rows, tuple(str(line) for line in data["made_with"]))
    except (ValueError, TypeError, KeyError) as error:
        raise ValueError(f"{path} is not a study beside a page: {error}") from error


def _row(data: dict[str, object]) -> Row:
    cost = data.pop("cost")
    return Row(**data, cost=Cost(**cost) if isinstance(cost, dict) else None)  # type: ignore[arg-type]
