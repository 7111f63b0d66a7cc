"""A recording replayed by the loops of gateway, haptics and physics on a real bus: the same states, to the bit."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from tests.physics.conftest import let_time_pass
from trocar.protocol import Frame
from trocar.protocol.bodies import PhysicsState
from trocar.protocol.topics import published_by, read_by
from trocar.services.cli.rerun import Rerun, load
from trocar.services.gateway.replaying import Replay
from trocar.services.haptics import __main__ as haptics
from trocar.services.haptics.__main__ import Haptics
from trocar.services.haptics.replaying import ReplayedHaptics
from trocar.services.physics import __main__ as physics
from trocar.services.physics.__main__ import Physics
from trocar.services.physics.replaying import ReplayedPhysics
from trocar.services.recordings.inputs import RecordedInputs, read_inputs
from trocar.services.recordings.schedule import read_schedule
from trocar.services.runtime.bus.zmq_bus import ZmqBus
from trocar.services.runtime.config.rig import ReplaySettings, Transport
from trocar.services.runtime.loop.loop import LoopMeter, follow_topic
from trocar.services.runtime.process.health import HealthReporter


@dataclass
class _Process:
    """A process of the table on a real bus, in a thread."""

    name: str
    bus: ZmqBus
    ended: threading.Event
    log: logging.Logger = field(default_factory=lambda: logging.getLogger("test"))

    def __post_init__(self) -> None:
        self.health = HealthReporter(self.name, self.bus)

    def stop(self) -> bool:
        return self.ended.is_set()


class Processes:
    """Gateway, haptics and physics of a replay, each in a thread; a listener has every state."""

    def __init__(self, inputs: RecordedInputs, folder: Path, **asked: Any) -> None:
        self.states: list[PhysicsState] = []
        self._settings = ReplaySettings(file=inputs.path, rate=0.0, **asked)
        self._transport = Transport(directory=folder)
        self._prepared = load(inputs)
        self._ended = threading.Event()
        self._errors: list[BaseException] = []

    def run(self, starts: tuple[str, ...]) -> None:
        """Start the processes in this order, and wait until the gateway has replayed."""
        threads = [threading.Thread(target=self._guarded, args=(getattr(self, f"_{name}"),)) for name in starts]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        if self._errors:
            raise self._errors[0]

    def _guarded(self, run: Callable[[], None]) -> None:
        try:
            run()
        except BaseException as error:
            self._errors.append(error)
            self._ended.set()

    def _open(self, stack: ExitStack, name: str) -> Any:
        reads = [each for each in read_by(name) if not each.endswith(".health")]
        bus = stack.enter_context(closing(ZmqBus(self._transport, publishes=published_by(name), reads=reads)))
        return _Process(name, bus, self._ended)

    def _gateway(self) -> None:
        with ExitStack() as stack:
            process = self._open(stack, "gateway")
            settings = self._settings.model_copy(update={"take_over": True})  # so that it returns
            Replay(process, settings, LoopMeter(1000.0)).run()
            self._ended.set()

    def _haptics(self) -> None:
        with ExitStack() as stack:
            process, meter = self._open(stack, "haptics"), LoopMeter(1000.0, haptics.STAGES)
            schedule = read_schedule(self._settings)
            replay = ReplayedHaptics(process, lambda inside: Haptics(inside, meter, *self._prepared), schedule)
            for frame in self._frames(process, "gateway.state", meter):
                replay.answer(frame)

    def _physics(self) -> None:
        with ExitStack() as stack:
            process, meter = self._open(stack, "physics"), LoopMeter(1000.0, physics.STAGES)
            stepping = Physics(process, meter, *self._prepared)
            publish = process.bus.publish
            process.bus.publish = lambda topic, body, **rest: (self._keep(body), publish(topic, body, **rest))[1]
            replay = ReplayedPhysics(stepping, read_schedule(self._settings))
            for frame in self._frames(process, "haptics.contacts", meter, stepping.do_side_work):
                assert replay.replay_frame(frame)

    def _frames(
        self, process: Any, topic: str, meter: LoopMeter, settle: Callable[[], object] = lambda: None
    ) -> Iterator[Frame]:
        return (each for each in follow_topic(process.bus, topic, meter, process.stop, settle) if each is not None)

    def _keep(self, body: Any) -> None:
        if isinstance(body, PhysicsState):
            self.states.append(body)


@pytest.mark.parametrize("starts", [("gateway", "haptics", "physics"), ("physics", "haptics", "gateway")])
def test_the_processes_make_the_same_states(
    recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, starts: tuple[str, ...]
) -> None:
    """In whatever order they start, whatever the threads do to each other."""
    let_time_pass(monkeypatch)
    inputs = read_inputs(recorded)
    rerun = Rerun(*load(inputs))
    made = [state for intake in inputs.intakes if (state := rerun.step(intake)[1]) is not None]
    processes = Processes(inputs, tmp_path)
    processes.run(starts)
    replayed = {state.tick: state for state in processes.states}
    # The last one may be under way when the gateway has its answer.
    assert [replayed[state.tick] for state in made[:-2]] == made[:-2]
    assert set(replayed) <= {intake.tick for intake in inputs.intakes if intake.ticks}


def test_from_the_beginning_again_and_up_to_where_hands_take_over(
    recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    let_time_pass(monkeypatch)
    inputs = read_inputs(recorded)
    first = inputs.intakes[0].tick
    processes = Processes(inputs, tmp_path, until_s=0.2)
    processes.run(("haptics", "physics", "gateway"))
    assert first + 190 < max(state.tick for state in processes.states) <= first + 200
