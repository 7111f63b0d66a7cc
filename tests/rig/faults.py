"""What the tests of faults share: a hand that feels something, and how its force changes."""

from __future__ import annotations

import itertools
import math

from services.gateway.servo_law import MAX_STEP_S
from services.runtime.config import load_rig
from tests.rig.conftest import Rig, Sample

MENDED_S = 60.0


def force_n(sample: Sample) -> float:
    return math.hypot(*sample.force_n)


def rate_limit_n_s() -> float:
    """Return how fast a force may change, with room for rounding."""
    return load_rig("stub").gateway.force_rate_limit_n_s * (1.0 + 1e-9)


def engage(rig: Rig) -> None:
    """Wait until the rig runs and the left hand feels the duct."""
    rig.observer.until(lambda: rig.observer.rig_state in ("running", "degraded"), MENDED_S, "running")
    rig.observer.samples.clear()
    rig.observer.until(
        lambda: len(rig.observer.samples) > 300 and min(force_n(s) for s in rig.observer.samples[-50:]) > 0.02,
        MENDED_S, "a force at the left hand",
    )  # fmt: skip


def force_rates_n_s(samples: list[Sample]) -> list[float]:
    """Return how fast the force changed from tick to tick of each gateway, by the times that its servo goes by.

    A tick that comes late may step as if it were `servo_law.MAX_STEP_S` long, and no further.
    """
    return [
        math.dist(b.force_n, a.force_n) / min(1e-9 * (b.sampled_ns - a.sampled_ns), MAX_STEP_S)
        for a, b in itertools.pairwise(samples)
        if b.incarnation == a.incarnation and b.tick == a.tick + 1
    ]
