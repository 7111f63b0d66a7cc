"""Jaws that squeeze take hold, and only then does haptics look at what they touch."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.physics.conftest import PORTS, Rig
from trocar.protocol.bodies import HeldPoint
from trocar.services.mechanics.collision.pairs import CATHETER_SEGMENT

FAR, ACROSS_RAD = (0.02, -0.05, 0.08), 0.5 * math.pi
OPEN_RAD, CLOSING_TICKS = 0.5, 200


def round_catheter(rig: Rig) -> tuple[float, float, float]:
    """Return where J is when the catheter, far from the duct, lies half way along the jaws of the first tool."""
    held = rig.physics.simulation.catheter.state.position_m[5]
    along = held - np.array(PORTS[0])
    x, y, z = held - 9e-3 * along / np.linalg.norm(along)
    return float(x), float(y), float(z)


def test_jaws_that_close_round_the_catheter_hold_it_until_they_open(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    spy, looked = type(rig.gateway)(rig.hub, reads=["haptics.contacts"]), []
    find = rig.haptics.grasping.touches.find

    def watched(tools: list[int], *arguments: object) -> None:
        looked.append(list(tools))
        find(tools, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(rig.haptics.grasping.touches, "find", watched)
    junction, held = round_catheter(rig), list[tuple[HeldPoint, ...]]()
    for k in range(CLOSING_TICKS + 60):
        handle_rad = OPEN_RAD * max(0.0, 1.0 - k / CLOSING_TICKS) if k < CLOSING_TICKS + 50 else OPEN_RAD
        rig.turn(junction, FAR, handle_rad=handle_rad, roll_rad=ACROSS_RAD)
        frame = spy.latest("haptics.contacts")
        assert frame is not None
        held.append(frame.body.holds)
    began = next(k for k, holds in enumerate(held) if holds)
    assert [len(holds) for holds in held] == [0] * began + [2] * (CLOSING_TICKS + 50 - began) + [0] * 10
    assert {(hold.tool, hold.target_kind) for hold in held[began]} == {(0, CATHETER_SEGMENT)}
    assert all(abs(hold.target + hold.target_weights[1] - 5.0) < 2.0 for hold in held[began])
    assert held[-11][0].limit_n > 0.0
    assert looked[began] == [0]
    assert not any(0 in tools for tools in looked[: began - 5] + looked[began + 1 :]), "there was nothing to close on"


def test_jaws_that_close_on_nothing_hold_nothing(rig: Rig) -> None:
    spy = type(rig.gateway)(rig.hub, reads=["haptics.contacts"])
    for k in range(60):
        rig.turn((0.09, 0.0, 0.04), FAR, handle_rad=OPEN_RAD * max(0.0, 1.0 - k / 40))
        frame = spy.latest("haptics.contacts")
        assert frame is not None
        assert frame.body.holds == ()
