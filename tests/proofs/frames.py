"""Garbled frames, and whole ones among them: each is refused by name or is a valid body, a whole one is valid."""

from __future__ import annotations

import random
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from tests.proofs.trials import Found, Proof, Try
from tests.protocol.garbled import garbled, outcome

AT_ONCE = 100_000  # a line for every five seconds or so


@contextmanager
def _begin() -> Iterator[Try]:
    yield try_frames


def try_frames(chance: np.random.Generator, count: int = AT_ONCE) -> Found:
    """Decode so many."""
    draws, why, valid = random.Random(int(chance.integers(2**63))), [], 0
    for _ in range(count):
        topic, data = garbled(draws)
        try:
            valid += outcome(topic, data) == "valid"
        except Exception as error:  # anything but a frame that is refused
            why.append(f"{topic} {data[:200].hex()}: {error!r}")
    return Found(tried=count, failed=len(why), why=tuple(why[:10]), figures={"valid": valid})


PROOF = Proof("frames", "frames, of nine eight garbled", 10_000_000, "refused, or valid; whole ones are valid", _begin)
