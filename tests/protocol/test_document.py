"""docs/reference/wire.md says what the code does."""

from __future__ import annotations

from pathlib import Path

from trocar.protocol.document import document

WIRE = Path(__file__).parents[2] / "docs" / "reference" / "wire.md"


def test_the_page_is_the_code() -> None:
    assert WIRE.read_text(encoding="utf-8") == document(), "run `python -m trocar.protocol.document`"
