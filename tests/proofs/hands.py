"""Hands at a wall, and pairs at one piece of tissue, that a search (CMA-ES) moves towards those that gain energy.

Where nothing bounds the energy, 12 of 16 searches at the Premium and the Touch X find hands that gain.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from tests.proofs.trials import Found, Proof, Try
from trocar.studies.feel.hunt import GENERATIONS, HUNTED_KG, Told, hunt, hunt_pairs

KINDS = (*HUNTED_KG, "pairs")
#: The longest delay that servos are told, s: anywhere up to a tick, and what the device files tell.
LATEST_S = 1e-3


@contextmanager
def _begin() -> Iterator[Try]:
    yield try_hands


def try_hands(chance: np.random.Generator, *, bounded: bool = True, generations: int = GENERATIONS) -> Found:
    """Make one search, at an arm or for pairs; its hands are not independent, the searches are."""
    kind, seed = KINDS[int(chance.integers(len(KINDS)))], int(chance.integers(2**31))
    if kind == "pairs":
        found = hunt_pairs(1, bounded=bounded, first_seed=seed, generations=generations)
    else:
        told = Told(None if chance.random() < 0.5 else float(chance.uniform(0.1, 1.0)) * LATEST_S)
        found = hunt(kind, 1, bounded=bounded, told=told, first_seed=seed, generations=generations)
    why = (f"search {seed}: {found.row()}",) if found.gaining else ()
    return Found(kind=kind, tried=found.hands, failed=found.gaining, why=why, figures={"most J": found.most_j})


PROOF = Proof("hands", "hands tried by a search", 100_000, "none gains energy", _begin, chance_of="searches")
