"""Processes killed and stopped, on the real bus: the hand feels a fade, the rig mends itself.

Each process once by day; each with either signal in the long run, and by chance in `tests.rig.kills`.
"""

from __future__ import annotations

import itertools
import signal

import pytest

from services.recordings.reader import read_frames
from tests.rig.conftest import Rig
from tests.rig.faults import FAULTS, strike

pytestmark = [pytest.mark.rig, pytest.mark.timeout(600)]

BY_DAY = [
    ("haptics", signal.SIGSTOP),
    ("physics", signal.SIGKILL),
    ("gateway", signal.SIGKILL),
    ("visualization", signal.SIGSTOP),
    ("recorder", signal.SIGKILL),
]


@pytest.mark.parametrize(
    ("name", "number"),
    [
        pytest.param(*each, id=f"{each[0]}-{each[1].name}", marks=[pytest.mark.long] * (each not in BY_DAY))
        for each in FAULTS
    ],
)
def test_a_process_that_dies_or_hangs(rig: Rig, name: str, number: signal.Signals) -> None:
    strike(rig, name, number)


def test_recordings_up_to_then_are_readable(rig: Rig) -> None:
    """A recorder died in this module by SIGKILL: what it wrote until then is there."""
    files = sorted((rig.directory / "recordings").glob("*.mcap"))
    assert len(files) >= 2
    # The first recorder lived for many seconds; one that was struck just after its start may not have filled a chunk.
    frames = [each.frame for each in read_frames(files[0], ["gateway.state"])]
    assert len(frames) > 3000
    steps = [b.sequence - a.sequence for a, b in itertools.pairwise(frames) if a.incarnation == b.incarnation]
    assert set(steps) == {1}, "every frame that a gateway sent is there, and once"
