"""A command is carried out or given up, never both: whoever is stopped, and wherever."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import trocar.protocol.bodies as bodies
from tests.supervisor.made_up import Bench, rig
from trocar.services.runtime.bus.claim import Claim
from trocar.services.runtime.bus.stop_line import StopLine, stop_gateway
from trocar.services.runtime.config.rig import Transport
from trocar.services.runtime.errors import BusError
from trocar.services.supervisor.control.commands import Command
from trocar.services.supervisor.judge.state_machine import RigState
from trocar.services.supervisor.page import command_socket as control_module
from trocar.services.supervisor.page.command_socket import CommandSocket, Link, ask_rig

#: More than a supervisor needs between a command and the last moment for its answer.
GIVES_UP_S = 1.4


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    tmp_path.chmod(0o700)
    made = Bench(rig(transport={"directory": tmp_path}))
    made.run(5.0, lambda: made.supervisor.state is RigState.RUNNING)
    return made


def _asked(bench: Bench, what: str) -> Callable[[], bodies.Answer]:
    command = Command(what=what, who="a test")  # type: ignore[arg-type]
    return lambda: ask_rig(bench.supervisor.rig.transport, command, patience_s=GIVES_UP_S)


@pytest.mark.parametrize("what", ["arm", "safe_stop"])
def test_who_was_stopped_between_the_clock_and_the_deed_does_nothing_late(
    bench: Bench, control: CommandSocket, what: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`trocar safe-stop` said that nobody answers, and the hands were let go a while later."""
    with ThreadPoolExecutor(1) as pool, monkeypatch.context() as stopped:
        stopped.setattr(Link, "receive_claimed", lambda _link, _kind: None)
        asked = pool.submit(_asked(bench, what))
        while not asked.done():
            control.run_turn(bench.now_s)
            time.sleep(1e-3)
        with pytest.raises(BusError, match="does not answer: nothing is done any more"):
            asked.result()
    control.run_turn(bench.now_s)  # it had looked at the clock, was stopped, and goes on with what it saw
    assert (bench.supervisor.body().armed, bench.supervisor.body().safe_stop) == (0, False)
    assert "given up by its sender" in bench.supervisor.events[-1].text


def test_what_was_begun_is_said_to_be(bench: Bench, control: CommandSocket, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stopped between the deed and its answer."""
    monkeypatch.setattr(control_module, "_BEGUN_S", 0.1)
    with ThreadPoolExecutor(1) as pool:
        asked = pool.submit(_asked(bench, "arm"))
        while not asked.done():
            control.run_turn(bench.now_s)  # no report of the gateway ever comes
            time.sleep(1e-3)
    assert asked.result() == bodies.Answer(
        order=0, ok=False, text="the supervisor has begun with it, and has not said what came of it"
    )
    assert bench.supervisor.body().armed == 1


def test_a_gateway_that_was_stopped_lets_nobody_go_after_it_was_said_not_to_answer(tmp_path: Path) -> None:
    tmp_path.chmod(0o700)
    transport = Transport(directory=tmp_path)
    with closing(StopLine(transport)) as line:
        assert stop_gateway(transport) is False
        assert not line.is_asked()
        with ThreadPoolExecutor(1) as pool:
            asked = pool.submit(stop_gateway, transport)
            while not line.is_asked():
                time.sleep(1e-3)
            assert asked.result() is True


@settings(max_examples=50)
@given(pauses_us=st.lists(st.integers(0, 300), min_size=2, max_size=2))
def test_a_claim_is_taken_by_exactly_one(pauses_us: list[int]) -> None:
    with closing(Claim.new()) as claim:
        taken: list[bool] = []

        def take(pause_us: int) -> None:
            time.sleep(1e-6 * pause_us)
            taken.append(claim.take_claim())

        threads = [threading.Thread(target=take, args=(pause_us,)) for pause_us in pauses_us]
        for each in threads:
            each.start()
        for each in threads:
            each.join()
        assert sorted(taken) == [False, True]
