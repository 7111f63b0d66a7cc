"""Each process killed and stopped in turn, on the real bus: the hand feels a fade, the rig mends itself."""

from __future__ import annotations

import itertools
import os
import signal
import time

import pytest

from services.recorder.recording import read
from tests.rig.conftest import Rig, Sample
from tests.rig.faults import MENDED_S, engage, force_n, force_rates_n_s, rate_limit_n_s

pytestmark = [pytest.mark.rig, pytest.mark.timeout(600)]

#: Of the gateway, each of a millisecond or more, in which force is gone: the ttl of models, and to let go. Counted in
#: these, as a machine that stands still runs none; figures in time are in benchmarks/.
TICKS = 120


FAULTS = [
    (name, number)
    for name in ("haptics", "physics", "gateway", "visualization", "recorder")
    for number in (signal.SIGKILL, signal.SIGSTOP)
]


@pytest.mark.parametrize(("name", "number"), FAULTS, ids=[f"{n}-{s.name}" for n, s in FAULTS])
def test_a_process_that_dies_or_hangs(rig: Rig, name: str, number: signal.Signals) -> None:
    observer = rig.observer
    engage(rig)
    before, incarnation = observer.pids(), observer.samples[-1].incarnation
    observer.samples.clear()
    noticed = len(observer.states)
    os.kill(before[name], number)
    struck_ns = time.monotonic_ns()

    observer.until(lambda: any(_is_lost(s, name, before) for _, s in observer.states[noticed:]), MENDED_S, "noticed")

    observer.until(
        lambda: observer.report(name) == "ready" and observer.pids()[name] not in (0, before[name]),
        MENDED_S, f"{name} back",
    )  # fmt: skip
    observer.until(lambda: observer.rig_state in ("running", "degraded"), MENDED_S, "running again")
    after = observer.pids()
    assert {k: v for k, v in after.items() if k != name} == {k: v for k, v in before.items() if k != name}
    if name in ("haptics", "physics"):
        _assert_fades_and_returns(rig, struck_ns)
    observer.until(lambda: force_n(observer.samples[-1]) > 0.02, MENDED_S, "a force at the left hand")
    rates_n_s = force_rates_n_s(observer.samples)
    assert len(rates_n_s) > 50
    assert max(rates_n_s) <= rate_limit_n_s()
    if name == "gateway":
        new = [s for s in observer.samples if s.incarnation != incarnation]
        assert new
        assert force_n(new[0]) == 0.0, "a gateway that starts anew begins limp"


def _is_lost(state: object, name: str, before: dict[str, int]) -> bool:
    report = next(p for p in state.processes if p.name == name)  # type: ignore[attr-defined]
    return report.state != "ready" or report.pid != before[name]


def _first(samples: list[Sample], begin: int, *, felt: bool) -> int | None:
    """Return the number of the first sample from one on that has a force, or none."""
    return next((k for k in range(begin, len(samples)) if (force_n(samples[k]) > 1e-9) is felt), None)


def _assert_fades_and_returns(rig: Rig, struck_ns: int) -> None:
    """After the ttl the hand feels nothing, until the force returns through re-engagement."""
    samples = rig.observer.samples
    struck = next(k for k, sample in enumerate(samples) if sample.sent_ns > struck_ns)
    limp = _first(samples, struck, felt=False)
    assert limp is not None
    assert limp - struck <= TICKS
    rig.observer.until(lambda: _first(samples, limp, felt=True) is not None, MENDED_S, "force back")
    returned = _first(samples, limp, felt=True)
    assert returned is not None
    assert samples[returned].state in ("engaging", "active")


def test_recordings_up_to_then_are_readable(rig: Rig) -> None:
    """Two recorders died in this module, one by SIGKILL: what they wrote until then is there."""
    files = sorted((rig.directory / "recordings").glob("*.mcap"))
    assert len(files) >= 3
    # The first recorder lived for many seconds; one that was struck just after its start may not have filled a chunk.
    frames = [message.body.envelope for message in read(files[0]) if message.topic == "gateway.state"]
    assert len(frames) > 3000
    steps = [b.sequence - a.sequence for a, b in itertools.pairwise(frames) if a.incarnation == b.incarnation]
    assert set(steps) == {1}, "every frame that a gateway sent is there, and once"
