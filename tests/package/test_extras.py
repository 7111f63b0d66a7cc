"""The extras of the package: `all` is all, and what is told of a missing package brings it."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from trocar.services.messages.extras import EXTRAS, how_to_get, requirements_of

ROOT = Path(__file__).parents[2]
DECLARED = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]


def test_all_is_all() -> None:
    (named,) = DECLARED["all"]
    inside = re.fullmatch(r"trocar\[(.*)\]", named)
    assert inside is not None
    assert sorted(inside[1].split(",")) == sorted(DECLARED.keys() - {"all"})


def test_every_package_of_an_extra_is_told_how_to_get() -> None:
    """By the requirement itself: a name on an index that has no Trocar, or another one, is no advice."""
    assert set(EXTRAS.values()) == {name for name, brought in DECLARED.items() if brought} - {"all"}
    for package, extra in EXTRAS.items():
        advice = how_to_get(package)
        for requirement in DECLARED[extra]:
            assert re.split(r"[<>=;\[]", requirement)[0] in advice
        assert "trocar[" not in advice


def test_an_extra_that_is_none_requires_nothing() -> None:
    assert requirements_of("nonsense") == []
    assert how_to_get("zmq").endswith(" -m pip install zmq")
