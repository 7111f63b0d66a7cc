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

TTL_S = 0.020
# The machine that runs the tests may be busy: what is asserted is the mechanism, figures are in benchmarks/.
SLACK_S = 0.100


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
    struck_ns = time.monotonic_ns()
    os.kill(before[name], number)

    noticed = len(observer.states)
    observer.until(lambda: any(_is_lost(s, name, before) for _, s in observer.states[noticed:]), 10.0, "noticed")

    observer.until(
        lambda: observer.report(name) == "ready" and observer.pids()[name] not in (0, before[name]),
        MENDED_S, f"{name} back",
    )  # fmt: skip
    observer.until(lambda: observer.rig_state in ("running", "degraded"), MENDED_S, "running again")
    after = observer.pids()
    assert {k: v for k, v in after.items() if k != name} == {k: v for k, v in before.items() if k != name}
    late_ns = struck_ns + round((TTL_S + SLACK_S) * 1e9)
    observer.until(lambda: _returned(observer.samples, late_ns) is not None, MENDED_S, "force back")
    if name in ("haptics", "physics"):
        _assert_faded(observer.samples, late_ns)
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


def _returned(samples: list[Sample], late_ns: int) -> Sample | None:
    return next((s for s in samples if s.sent_ns > late_ns and force_n(s) > 1e-9), None)


def _assert_faded(samples: list[Sample], late_ns: int) -> None:
    """After the ttl the hand feels nothing, until the force returns through re-engagement."""
    first = next(s for s in samples if s.sent_ns > late_ns)
    assert force_n(first) == pytest.approx(0.0, abs=1e-9)
    returned = _returned(samples, late_ns)
    assert returned is not None
    assert returned.state in ("engaging", "active")


def test_recordings_up_to_then_are_readable(rig: Rig) -> None:
    """Two recorders died in this module, one by SIGKILL: what they wrote until then is there."""
    files = sorted((rig.directory / "recordings").glob("*.mcap"))
    assert len(files) >= 3
    # The first recorder lived for many seconds; one that was struck just after its start may not have filled a chunk.
    frames = [message.body.envelope for message in read(files[0]) if message.topic == "gateway.state"]
    assert len(frames) > 3000
    steps = [b.sequence - a.sequence for a, b in itertools.pairwise(frames) if a.incarnation == b.incarnation]
    assert set(steps) == {1}, "every frame that a gateway sent is there, and once"
