"""The page of the Python API: every public array of hands and their results stands there with its shape and frame."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import pytest

import trocar

PAGE = (Path(__file__).parents[2] / "docs" / "reference" / "python-api.md").read_text(encoding="utf-8")
_ATTRIBUTE = re.compile(r"^(\w+) : (\(.*?\))(?: \w+)?$", re.MULTILINE)
_FRAMES = ("scene", "none")


def arrays() -> list[tuple[str, str]]:
    """Return name and shape of every array that the docstrings of the front door describe."""
    found = [each for kind in (trocar.Hands, trocar.HandResults) for each in _ATTRIBUTE.findall(inspect.getdoc(kind))]
    functions = (trocar.wall_m, trocar.tip_m)
    return found + [(f.__name__, re.search(r"\([n3, ]+\)", inspect.getdoc(f) or "")[0]) for f in functions]  # type: ignore[index]


@pytest.mark.parametrize(("name", "shape"), arrays())
def test_every_array_is_on_the_page_with_shape_and_frame(name: str, shape: str) -> None:
    rows = [row.split("|")[1:-1] for row in PAGE.splitlines() if row.startswith("|") and f"`{name}`" in row]
    assert len(rows) == 1, name
    names, shapes, frame, _ = rows[0]
    place = re.findall(r"`(\w+)`", names).index(name)
    told = re.findall(r"\([\d, n]*\)", shapes)
    assert told[min(place, len(told) - 1)] == shape
    assert frame.strip() in _FRAMES


def test_there_are_all() -> None:
    assert len(arrays()) == 13
