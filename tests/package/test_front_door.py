"""The package `trocar`: what it names is there, described, and works without the rest."""

from __future__ import annotations

import inspect
from collections.abc import Iterator

import pytest

import trocar
from trocar.services.mechanics.effects import EFFECTS


@pytest.fixture
def known_effects() -> Iterator[None]:
    before = dict(EFFECTS)
    yield
    EFFECTS.clear()
    EFFECTS.update(before)


def test_every_public_name_is_there_and_described() -> None:
    assert trocar.__all__ == sorted(trocar.__all__)
    assert not [name for name in trocar.__all__ if not inspect.getdoc(getattr(trocar, name))]


def test_an_effect_is_added_once(known_effects: None) -> None:
    trocar.add_effect("current", trocar.Effect, "nothing")
    with pytest.raises(ValueError, match="there is an effect 'current' already: nothing"):
        trocar.add_effect("current", trocar.Effect, "nothing again")


def test_a_scene_that_is_not_there_is_refused_by_name() -> None:
    with pytest.raises(trocar.ConfigError, match="insertion"):
        trocar.load_scene("insertoin")
