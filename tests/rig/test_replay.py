"""Recordings as devices through the real processes, beside whatever takes their cores: the same states, to the bit."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from tests.made_samples import SUCCESS, make_sample
from tests.patience import PATIENCE_S
from tests.ports import free_port
from tests.recorder.conftest import recorded
from tests.with_us import with_us
from trocar.protocol.bodies import PhysicsState
from trocar.services.recordings.inputs import RecordedInputs, read_inputs
from trocar.services.runtime.bus.zmq_bus import ZmqBus
from trocar.services.runtime.config.rig import Transport

__all__ = ["recorded"]
pytestmark = pytest.mark.timeout(900)

UNTIL_S = 2.5
#: Takes what its core has left: alone these tests have a neighbour, too, and in the whole suite no test has less.
BUSY = "import os; os.nice(19); os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})\nwhile True: pass"


@pytest.fixture(autouse=True)
def load() -> Iterator[None]:
    with subprocess.Popen(with_us([sys.executable, "-c", BUSY])) as busy:
        yield
        busy.kill()


def test_an_insertion_ends_as_it_was_recorded(tmp_path: Path) -> None:
    """As in the sample, but by the mechanics of today."""
    inputs = read_inputs(make_sample(tmp_path / "insertion.mcap", 2600))
    assert_same(inputs, replayed(inputs))


def test_a_sample_of_whatever_version_is_replayed_to_its_end() -> None:
    inputs = read_inputs(SUCCESS)
    said = replayed(inputs)
    assert said.keys() >= {tick for tick in inputs.states if tick < inputs.intakes[-1].tick}


def test_a_rig_that_lost_ticks_ends_as_it_was_recorded(recorded: Path) -> None:
    inputs = read_inputs(recorded)
    assert any(intake.ticks > 1 for intake in inputs.intakes)
    assert_same(inputs, replayed(inputs))


def replayed(inputs: RecordedInputs) -> dict[int, PhysicsState]:
    """Return by tick what physics said while `trocar replay` ran, until that ended by itself."""
    with tempfile.TemporaryDirectory(prefix="replay-") as short:  # a socket's path has 107 characters at most
        return _replayed(inputs, Path(short))


def _replayed(inputs: RecordedInputs, folder: Path) -> dict[int, PhysicsState]:
    transport = Transport(directory=folder / "bus")
    settings = (
        f"transport.directory={transport.directory}", "processes.recorder.enabled=false",
        f"supervisor.web.port={free_port()}",
    )  # fmt: skip
    asked = ["--until", str(UNTIL_S), "--viewer", "none", *(word for each in settings for word in ("--set", each))]
    command = [sys.executable, "-m", "trocar.services.cli.app", "replay", str(inputs.path), *asked]
    said: dict[int, PhysicsState] = {}
    with (folder / "log").open("wb") as log, closing(ZmqBus(transport, reads_every=["physics.state"])) as bus:
        process = subprocess.Popen(with_us(command), stdout=log, stderr=subprocess.STDOUT)
        try:
            while process.poll() is None:
                said.update((frame.body.tick, frame.body) for frame in bus.drain("physics.state"))
                bus.wait("physics.state", time.monotonic_ns() + 20_000_000)
        finally:
            process.terminate()
            process.wait(PATIENCE_S)
    assert process.returncode == 0, (folder / "log").read_text()[-3000:]
    return said


def assert_same(inputs: RecordedInputs, said: dict[int, PhysicsState]) -> None:
    """Fail unless all states that were kept were said again, to the bit, and the last of them was reached."""
    last = min(inputs.intakes[0].tick + round(1e3 * UNTIL_S), inputs.intakes[-1].tick)
    kept = {tick: state for tick, state in inputs.states.items() if tick < last}
    assert len(kept) > 10
    assert said.keys() >= kept.keys()
    assert [tick for tick, state in kept.items() if said[tick] != state] == []
