"""Kills and freezes of a running rig, at moments that are drawn: each is mended."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from tests.patience import PATIENCE_S
from tests.proofs.trials import Found, Proof, Try
from tests.rig.conftest import HERE, SCENE, running_rig
from tests.rig.faults import FAULTS, HARD, strike

PACE = 2.0  # of the hand: it presses and lifts twice as fast as in the tests by day
PRESS_S = 4.2 / PACE  # from one press to the next
PRESSES = (
    *HARD,
    *(
        f"gateway.instruments.{i}.arm.settings.{setting}"
        for i in (0, 1)
        for setting in (f"script={HERE / 'press.yaml'}", f"pace={PACE}")
    ),
)
# Whoever is struck often is given up, or restarted later and later: not here.
PATIENT = ("supervisor.max_restarts_per_minute=600", "supervisor.backoff_s=[0.1]")


@contextmanager
def _begin() -> Iterator[Try]:
    with tempfile.TemporaryDirectory() as folder, running_rig(Path(folder), str(SCENE), [*PRESSES, *PATIENT]) as rig:

        def try_once(chance: np.random.Generator) -> Found:
            name, number = FAULTS[chance.integers(len(FAULTS))]
            until_s = time.monotonic() + float(chance.uniform(0.0, PRESS_S))
            rig.observer.until(lambda: time.monotonic() >= until_s, PATIENCE_S, "a pause")
            kind, began_s = f"{name}, {number.name}", time.monotonic()
            try:
                pressed_n = strike(rig, name, number)
            except AssertionError as error:
                return Found(kind, failed=1, why=((str(error) or "an assertion without a word").splitlines()[0],))
            return Found(kind, figures={"s": round(time.monotonic() - began_s, 2), "N": round(pressed_n, 3)})

        yield try_once


PROOF = Proof(
    "faults", "kills and freezes", 1_000,
    "recovered, no force step", _begin,
)  # fmt: skip
