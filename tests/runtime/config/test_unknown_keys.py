"""No file of any kind takes a key that it does not know, wherever in it that stands."""

from __future__ import annotations

import copy
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.by_day import examples
from trocar.services.runtime.config import config
from trocar.services.runtime.config.rig import Rig
from trocar.services.runtime.errors import ConfigError

#: Every section of these is a class with settings; instruments, loops and processes among them.
RIGS = {
    path.stem: config.load_rig(path).model_dump(mode="json", exclude_none=True)
    for path in sorted((config.config_directory() / "rigs").glob("*.yaml"))
}
#: What is below them is named by a person, or belongs to a driver.
_FREE = ("settings", "hosts")


def sections(data: Any, path: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """Return the places of all mappings below this one whose keys are known."""
    if isinstance(data, list):
        return [place for k, each in enumerate(data) for place in sections(each, (*path, k))]
    if not isinstance(data, dict) or (path and path[-1] in _FREE):
        return []
    return [path, *(place for key, each in data.items() for place in sections(each, (*path, key)))]


PLACES = [(name, place) for name, data in RIGS.items() for place in sections(data)]


def test_there_are_many_places_to_look_at() -> None:
    assert len(PLACES) > 100
    assert {len(place) for _, place in PLACES} >= {0, 1, 2, 3}


@settings(max_examples=examples(50, 500))
@given(st.sampled_from(PLACES), st.from_regex(r"[a-z][a-z_]{2,12}", fullmatch=True), st.none() | st.integers())
def test_an_unknown_key_is_refused_with_its_path(where: tuple[str, Any], key: str, value: object) -> None:
    name, place = where
    data = copy.deepcopy(RIGS[name])
    section = data
    for step in place:
        section = section[step]
    key = f"{key}_of_nobody"
    section[key] = value
    with pytest.raises(ConfigError) as caught:
        config.build(Rig, data, "file")
    path = ".".join(map(str, (*place, key)))
    assert str(caught.value).startswith(f"file: {path}: "), str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", RIGS)
def test_without_it_the_same_is_taken(name: str) -> None:
    assert config.build(Rig, copy.deepcopy(RIGS[name]), "file") == config.load_rig(name)
