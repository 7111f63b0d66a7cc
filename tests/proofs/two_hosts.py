"""A rig on two hosts of which a fifth of the packets is lost: the arm may go limp, it is never kicked."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path

import numpy as np

from tests.patience import PATIENCE_S
from tests.proofs.trials import Found, Proof, Try
from tests.rig.faults import PRESSED_N, force_n, force_rates_n_s, rate_limit_n_s
from tests.rig.two_hosts import FarRig, Hosts, may_be_had

LOST, MOST_DELAY_MS, PRESS_S = 0.2, 20.0, 4.2
#: Whoever is slow goes on: the machine may be.
SLOW = tuple(f"contracts.loops.{loop}.stop_miss_ratio=1" for loop in ("gateway", "haptics", "physics"))
#: Who is on which host; the arm is on the first.
FAR_PHYSICS = {"gateway": 0, "haptics": 0, "physics": 1, "supervisor": 1}
FAR_SUPERVISOR = {"gateway": 0, "haptics": 0, "physics": 0, "supervisor": 1}


@contextmanager
def _begin(where: Mapping[str, int]) -> Iterator[Try]:
    with (
        tempfile.TemporaryDirectory() as folder,
        Hosts(Path(folder)) as hosts,
        closing(FarRig(Path(folder), hosts, where, SLOW)) as rig,
    ):
        rig.until_it_runs()
        yield partial(try_press, rig)


def try_press(rig: FarRig, chance: np.random.Generator) -> Found:
    """Press once on a bad road of its own, then again on a good one."""
    samples = rig.observer.samples
    _until_felt(rig)
    samples.clear()
    delay_ms, jitter_ms = chance.uniform(0.0, MOST_DELAY_MS, 2)
    rig.hosts.set(delay_ms, jitter_ms, LOST)
    rig.look_for(PRESS_S)
    limp = sum(force_n(each) == 0.0 for each in samples) / max(1, len(samples))
    why = []
    try:
        _until_felt(rig)
    except AssertionError:
        why.append(f"no force on a good road within {PATIENCE_S:g} s; {rig.observer.states[-1][1].reason}")
    fastest_n_s = max(force_rates_n_s(samples), default=float("nan"))
    if not fastest_n_s <= rate_limit_n_s():
        why.append(f"a force that changed by {fastest_n_s:.1f} N/s")
    why += [f"{name} has ended" for name in rig.ended()]
    return Found(failed=int(bool(why)), why=tuple(why), figures={"N/s": round(fastest_n_s, 2), "without force": limp})


def _until_felt(rig: FarRig) -> None:
    rig.hosts.set(0.0)
    samples = rig.observer.samples
    rig.observer.until(lambda: bool(samples) and force_n(samples[-1]) > PRESSED_N, PATIENCE_S, "a press")


_HOLDS = "no force step, force returns"
PHYSICS = Proof("far-physics", "presses, 20 % of packets lost, physics far", 100, _HOLDS,
                partial(_begin, FAR_PHYSICS), hindered=may_be_had)  # fmt: skip
SUPERVISOR = Proof("far-supervisor", "presses, 20 % of packets lost, supervisor far", 100, _HOLDS,
                   partial(_begin, FAR_SUPERVISOR), hindered=may_be_had)  # fmt: skip
