"""What the recorders of the rig have left, when nothing of it runs any more: the first of them was killed."""

from __future__ import annotations

import itertools

import pytest

from tests.rig.conftest import Rig
from trocar.services.recordings.reader import read_frames

pytestmark = [pytest.mark.rig, pytest.mark.timeout(600)]


def test_recordings_up_to_then_are_readable(rig: Rig) -> None:
    """A recorder died in this folder by SIGKILL: what it wrote until then is there."""
    files = sorted((rig.directory / "recordings").glob("*.mcap"))
    assert len(files) >= 2
    # The first recorder lived for many seconds; one that was struck just after its start may not have filled a chunk.
    frames = [each.frame for each in read_frames(files[0], ["gateway.state"])]
    assert len(frames) > 3000
    steps = [b.sequence - a.sequence for a, b in itertools.pairwise(frames) if a.incarnation == b.incarnation]
    assert set(steps) == {1}, "every frame that a gateway sent is there, and once"
