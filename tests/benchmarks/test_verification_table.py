"""A table of the verification page: a row for a quantity, its errors in the order of its meshes."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def beside(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(Path(__file__).resolve().parents[2] / "benchmarks")
    monkeypatch.delitem(sys.modules, "verification_table", raising=False)


def test_meshes_of_a_kind_share_a_row_and_what_all_rows_share_is_told_above() -> None:
    from verification_table import Entry, Table

    entries = [
        Entry("sag", "cst, 8 a side", 0.9, 1.0, "book", "mm"),
        Entry("sag", "cst, 16 a side", 0.99, 1.0, "book", "mm"),
        Entry("sag", "cst, 16 a side", 0.99, 1.0, "book", "mm"),
        Entry("sag", "andes, 8 a side", 1.02, 1.0, "book", "mm"),
        Entry("twist", "andes, 8 a side", 2.0, 2.0, "other book"),
    ]
    text = Table("Roof", "A roof.", entries).to_markdown()
    assert "A roof. Reference: book.\n" in text
    assert "| sag | cst, 8, 16 a side; andes, 8 a side | 1 mm | -10.00, -1.00; +2.00 |" in text
    assert "| twist | andes, 8 a side | 2; other book | +0.00 |" in text
    more = [Entry(name, "andes, 8 a side", 1.0, 1.0, "book") for name in ("bend", "pull")]
    most = Table("Roof", "A roof.", [*entries[:2], *more]).to_markdown()
    assert "A roof. Reference: book. Mesh: andes, 8 a side.\n" in most
    assert "| bend |  | 1 | +0.00 |" in most
    assert "| sag | cst, 8, 16 a side | 1 mm | -10.00, -1.00 |" in most
    both = [Entry("sag", f"{name}, {k} a side", 1.0, 1.0, "book") for name in ("cst", "andes") for k in (8, 16)]
    assert "Mesh: cst and andes, 8, 16 a side.\n" in Table("Roof", "A roof.", both).to_markdown()
    alone = Table("Roof", "A roof.", entries[:2]).to_markdown()
    assert "A roof. Reference: book. Mesh: cst, 8, 16 a side.\n" in alone
    assert "| sag | 1 mm | -10.00, -1.00 |" in alone
