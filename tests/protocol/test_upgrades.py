"""Old bodies are lifted one version at a time; versions that nobody knows are refused by name."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import msgspec
import pytest

import trocar.protocol.upgrades as upgrades
from tests.protocol import samples
from tests.protocol.test_golden import GOLDEN
from trocar.protocol import TOPICS, FrameError, Reason, bodies, decode, encode

NAME = "supervisor.state"


class Version1(msgspec.Struct, array_like=True, frozen=True):
    """As if version 1 had carried a number where version 2 has a word."""

    state: int


class Version2(msgspec.Struct, array_like=True, frozen=True):
    """As if version 2 had had no quality level."""

    state: str


@pytest.fixture
def third_version(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(TOPICS, NAME, replace(TOPICS[NAME], version=3))
    monkeypatch.setitem(upgrades.UPGRADES, (NAME, 1), (Version1, lambda b: Version2(["off", "running"][b.state])))
    monkeypatch.setitem(upgrades.UPGRADES, (NAME, 2), (Version2, lambda b: bodies.SupervisorState(state=b.state)))


def _frame(version: int, body: msgspec.Struct) -> bytes:
    return encode(msgspec.structs.replace(samples.frame(NAME), version=version, body=body))


@pytest.mark.usefixtures("third_version")
def test_old_versions_climb_to_the_current_one() -> None:
    for data in (_frame(1, Version1(1)), _frame(2, Version2("running"))):
        frame = decode(data, NAME)
        assert frame.version == 3
        assert frame.body == bodies.SupervisorState(state="running")


OLD = [
    ("haptics.contact_model", 1),
    ("haptics.contacts", 1),
    ("haptics.contacts", 2),
    ("haptics.contacts", 3),
    ("haptics.contacts", 4),
    ("physics.state", 1),
]


@pytest.mark.parametrize(("name", "version"), OLD)
def test_what_old_frames_say_is_kept(name: str, version: int) -> None:
    """The golden frames of all versions are of the same sample: lifted, they differ in what was not said yet."""
    lifted = msgspec.to_builtins(decode((GOLDEN / f"{name}.v{version}.msgpack").read_bytes(), name).body)
    assert len(set(_numbers(lifted)) - {0.0}) > 1
    assert set(_numbers(lifted)) <= {0.0, -1.0} | set(_numbers(msgspec.to_builtins(samples.body(name))))


def _numbers(value: object) -> Iterator[object]:
    if isinstance(value, list | tuple):
        for item in value:
            yield from _numbers(item)
    else:
        yield value


@pytest.mark.usefixtures("third_version")
def test_an_old_body_is_checked_as_what_it_was() -> None:
    with pytest.raises(FrameError) as caught:
        decode(_frame(1, Version2("running")), NAME)
    assert caught.value.reason is Reason.BODY


def test_a_version_that_was_dropped_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(TOPICS, NAME, replace(TOPICS[NAME], version=3))
    with pytest.raises(FrameError) as caught:
        decode(_frame(1, Version1(1)), NAME)
    assert caught.value.reason is Reason.UNKNOWN_VERSION
