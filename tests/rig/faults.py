"""What the tests of faults share: a hand that feels something, how its force changes, and a fault that is mended."""

from __future__ import annotations

import itertools
import math
import os
import signal
import time
from pathlib import Path

import numpy as np

from tests.patience import PATIENCE_S
from tests.rig.conftest import Rig, Sample
from trocar.services.gateway.servo.servo_law import MAX_STEP_S
from trocar.services.mechanics.scene import ForcepsScene
from trocar.services.runtime.config.config import load_rig

#: Of the gateway, each of a millisecond or more, in which force is gone: the ttl of models, and to let go. Counted in
#: these, as a machine that stands still runs none; figures in time are in benchmarks/.
TICKS = 120
#: Of the scene: a wall so hard that the script of `press.yaml` meets 1.4 N.
HARD = ("duct.youngs_modulus_pa=30.0e+6",)
#: A press that is felt. The rate limit allows 0.2 N in a tick: a hand that loses this at once takes a step five times
#: as large.
PRESSED_N = 1.0
#: Stiffness of the tools' coupling to the hand: no contact is felt stiffer.
STIFFEST_N_M = ForcepsScene().coupling_stiffness_n_m
FAULTS = [
    (name, number)
    for name in ("haptics", "physics", "gateway", "visualization", "recorder", "training")
    for number in (signal.SIGKILL, signal.SIGSTOP)
]


def force_n(sample: Sample) -> float:
    return math.hypot(*sample.force_n)


def rate_limit_n_s() -> float:
    """Return how fast a force may change, with room for rounding."""
    return load_rig("stub").gateway.force_rate_limit_n_s * (1.0 + 1e-9)


def engage(rig: Rig) -> None:
    """Wait until the rig runs and the left hand presses on the duct."""
    rig.observer.until(lambda: rig.observer.is_up, PATIENCE_S, "running")
    rig.observer.samples.clear()
    rig.observer.until(
        lambda: len(rig.observer.samples) >= 50 and min(force_n(s) for s in rig.observer.samples[-50:]) > PRESSED_N,
        PATIENCE_S, "a press of the left hand",
    )  # fmt: skip


def force_rates_n_s(samples: list[Sample]) -> list[float]:
    """Return how fast the force changed from tick to tick of each gateway, by the times that its servo goes by.

    A tick that comes late may step as if it were `servo_law.MAX_STEP_S` long, and no further. What the hand's own way
    along the force takes off a spring of `STIFFEST_N_M` is no change.
    """
    return [
        _change_n(a, b) / min(1e-9 * (b.sampled_ns - a.sampled_ns), MAX_STEP_S)
        for a, b in itertools.pairwise(samples)
        if b.incarnation == a.incarnation and b.tick == a.tick + 1
    ]


def _change_n(a: Sample, b: Sample) -> float:
    """Return how far the force of `b` is from that of `a`, of which a part may be unloaded."""
    before, after = np.array(a.force_n), np.array(b.force_n)
    held_n = float(np.linalg.norm(before))
    if held_n == 0.0:
        return float(np.linalg.norm(after))
    along = before / held_n
    unloaded_n = min(held_n, max(0.0, STIFFEST_N_M * float(along @ np.subtract(b.hip_m, a.hip_m))))
    fall_n = min(max(held_n - float(along @ after), 0.0), unloaded_n)
    return float(np.linalg.norm(after - before + fall_n * along))


def drives_of(gateway: int) -> list[int]:
    """Return the processes of a gateway's emulated drives: one, or none."""
    children = Path(f"/proc/{gateway}/task/{gateway}/children").read_text().split()
    return [int(pid) for pid in children if b"drive_process" in Path(f"/proc/{pid}/cmdline").read_bytes()]


def strike(rig: Rig, name: str, number: signal.Signals) -> float:
    """Send the signal to a process while the hand presses, and return how hard that was, N.

    All that has to be so until the rig is as before is so.
    """
    observer = rig.observer
    engage(rig)
    before, incarnation, pressed_n = observer.pids(), observer.samples[-1].incarnation, force_n(observer.samples[-1])
    observer.samples.clear()
    noticed = len(observer.states)
    os.kill(before[name], number)
    struck_ns = time.monotonic_ns()

    observer.until(lambda: any(_is_lost(s, name, before) for _, s in observer.states[noticed:]), PATIENCE_S, "noticed")

    observer.until(
        lambda: observer.report(name) == "ready" and observer.pids()[name] not in (0, before[name]),
        PATIENCE_S, f"{name} back",
    )  # fmt: skip
    observer.until(lambda: observer.is_up, PATIENCE_S, "running again")
    after = observer.pids()
    assert {k: v for k, v in after.items() if k != name} == {k: v for k, v in before.items() if k != name}
    if name in ("haptics", "physics"):
        _assert_fades_and_returns(rig, struck_ns)
    observer.until(lambda: force_n(observer.samples[-1]) > PRESSED_N, PATIENCE_S, "a press of the left hand")
    rates_n_s = force_rates_n_s(observer.samples)
    assert len(rates_n_s) > 50
    assert max(rates_n_s) <= rate_limit_n_s(), f"a force that changed by {max(rates_n_s):.1f} N/s"
    if name == "gateway":
        new = [s for s in observer.samples if s.incarnation != incarnation]
        assert new
        assert force_n(new[0]) == 0.0, "a gateway that starts anew begins limp"
    return pressed_n


def _is_lost(state: object, name: str, before: dict[str, int]) -> bool:
    report = next(p for p in state.processes if p.name == name)  # type: ignore[attr-defined]
    return report.state != "ready" or report.pid != before[name]


def _first(samples: list[Sample], begin: int, *, felt: bool) -> int | None:
    """Return the number of the first sample from one on that has a force, or none."""
    return next((k for k in range(begin, len(samples)) if (force_n(samples[k]) > 1e-9) is felt), None)


def _assert_fades_and_returns(rig: Rig, struck_ns: int) -> None:
    """After the ttl the hand feels nothing, until the force returns through re-engagement."""
    samples = rig.observer.samples
    rig.observer.until(
        lambda: bool(samples) and samples[-1].sent_ns > struck_ns, PATIENCE_S, "a sample after the fault"
    )
    struck = next(k for k, sample in enumerate(samples) if sample.sent_ns > struck_ns)
    limp = _first(samples, struck, felt=False)
    assert limp is not None
    assert limp - struck <= TICKS
    rig.observer.until(lambda: _first(samples, limp, felt=True) is not None, PATIENCE_S, "force back")
    returned = _first(samples, limp, felt=True)
    assert returned is not None
    assert samples[returned].state in ("engaging", "active")
