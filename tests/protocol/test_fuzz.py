"""Mutated and random frames: each is refused by name or decodes to a valid body, in bounded memory."""

from __future__ import annotations

import random
import secrets
import tracemalloc

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.protocol.garbled import SEEDS, garbled, outcome
from trocar.protocol import Reason

ROUNDS = 8_000
CHUNKS = 4


#: Where, what is taken out there, and what is put in its place.
edits = st.lists(st.tuples(st.integers(0, 1 << 16), st.integers(0, 40), st.binary(max_size=40)), max_size=6)


@settings(max_examples=400)
@given(st.sampled_from(list(SEEDS)), edits)
def test_a_frame_survives_any_mutation(topic: str, edits: list[tuple[int, int, bytes]]) -> None:
    data = SEEDS[topic]
    for at, length, new in edits:
        at %= len(data) + 1
        data = data[:at] + new + data[at + length :]
    outcome(topic, data)


@pytest.mark.parametrize("chunk", range(CHUNKS))
def test_nothing_a_peer_sends_gets_through_or_breaks(chunk: int) -> None:
    """Other bytes in every run, many at once, as what they make the decoder allocate is measured as well."""
    seed = secrets.randbits(32)
    print(f"chunk {chunk}: seed {seed}")
    chance = random.Random(seed)
    outcomes: dict[str, int] = {}
    tracemalloc.start()
    try:
        for _ in range(ROUNDS):
            found = outcome(*garbled(chance))
            outcomes[found] = outcomes.get(found, 0) + 1
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 4 << 20, "a frame of some kilobytes made the decoder allocate megabytes"
    # The mutations reach past the envelope: were everything refused as malformed, the test would show little.
    assert {"valid", Reason.MALFORMED, Reason.BODY} <= set(outcomes)
