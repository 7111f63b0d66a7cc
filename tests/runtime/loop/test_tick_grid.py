"""Moments are joined by their tick, in whatever order and however late their frames come."""

from __future__ import annotations

import random

from tests.protocol import samples
from trocar.protocol import Frame, bodies
from trocar.protocol.bodies.haptics import tool_table
from trocar.protocol.topics import MOMENT_TICKS
from trocar.services.runtime.loop.tick_grid import MOMENTS, STATES, Moments, as_state


def frames(tick: int) -> list[Frame]:
    told = (
        bodies.GatewayState(tick=tick),
        bodies.ToolContacts(tick=tick, tools=tool_table(())),
        samples.physics_state(tick, bodies.ToolReaction()),
    )
    return [Frame(1, name, 1, 1, 0, 0, 0, True, body) for name, body in zip(MOMENTS, told, strict=True)]


def test_a_moment_is_told_once_all_of_it_has_come() -> None:
    moments = Moments()
    gateway, haptics, physics = frames(MOMENT_TICKS)
    assert list(moments.take_frames([physics, gateway])) == []
    (found,) = moments.take_frames([haptics])
    assert tuple(found) == STATES
    assert {frame.body.tick for frame in found.values()} == {MOMENT_TICKS}
    assert [frame.topic for frame in found.values()] == list(STATES)


def test_every_moment_comes_whatever_the_order() -> None:
    chance, moments = random.Random(3), Moments()
    ticks = [MOMENT_TICKS * k for k in range(60)]
    mixed = [frame for tick in ticks for frame in frames(tick)]
    chance.shuffle(mixed)
    found = [moment for frame in mixed for moment in moments.take_frames([frame])]
    assert sorted(moment["physics.state"].body.tick for moment in found) == ticks


def test_what_never_comes_is_forgotten() -> None:
    moments = Moments()
    for k in range(1000):
        assert list(moments.take_frames(frames(MOMENT_TICKS * k)[:2])) == []
    assert len(moments._open) < 200
    assert len(list(moments.take_frames(frames(MOMENT_TICKS * 2000)))) == 1


def test_other_topics_stay_as_they_are() -> None:
    frame = Frame(1, "gateway.state", 1, 1, 0, 0, 0, True, bodies.GatewayState(tick=3))
    assert as_state(frame) is frame
