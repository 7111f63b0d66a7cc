"""Mutated and random frames: each is refused by name or decodes to a valid body, in bounded memory."""

from __future__ import annotations

import random
import secrets
import tracemalloc

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol import TOPICS, FrameError, Reason, decode, encode
from protocol.declared import fault
from tests.protocol import samples

ROUNDS = 8_000
SEEDS = [encode(samples.frame(name)) for name in TOPICS]
CHUNKS = 4


def _mutated(chance: random.Random) -> bytes:
    kind = chance.randrange(7)
    data = bytearray(chance.choice(SEEDS))
    if kind == 0:
        return chance.randbytes(chance.randrange(200))
    if kind == 1:
        return bytes(data[: chance.randrange(len(data))])
    if kind == 2:  # msgpack headers that claim more than there is
        at = chance.randrange(len(data))
        data[at : at + 1] = chance.choice((b"\xdd", b"\xdf", b"\xc6", b"\xdb", b"\xc9")) + b"\xff\xff\xff\xff"
    elif kind == 3:
        other = chance.choice(SEEDS)
        data[chance.randrange(len(data)) :] = other[chance.randrange(len(other)) :]
    elif kind == 4:  # deep nesting
        at = chance.randrange(len(data))
        data[at:at] = b"\x91" * chance.randrange(5000)
    else:
        for _ in range(chance.randrange(1, 6)):
            data[chance.randrange(len(data))] = chance.randrange(256)
    return bytes(data)


def _outcome(data: bytes) -> str:
    try:
        frame = decode(data)
    except FrameError as error:
        return Reason(error.reason)
    row = TOPICS[frame.topic]
    assert isinstance(frame.body, row.body)
    assert fault(frame.body, finite_scalars=row.command) is None
    return "valid"


#: Where, what is taken out there, and what is put in its place.
edits = st.lists(st.tuples(st.integers(0, 1 << 16), st.integers(0, 40), st.binary(max_size=40)), max_size=6)


@settings(max_examples=400)
@given(st.sampled_from(SEEDS), edits)
def test_a_frame_survives_any_mutation(data: bytes, edits: list[tuple[int, int, bytes]]) -> None:
    for at, length, new in edits:
        at %= len(data) + 1
        data = data[:at] + new + data[at + length :]
    _outcome(data)


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
            data = _mutated(chance)
            outcome = _outcome(data)
            outcomes[outcome] = outcomes.get(outcome, 0) + 1
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 4 << 20, "a frame of some kilobytes made the decoder allocate megabytes"
    # The mutations reach past the envelope: were everything refused as malformed, the test would show little.
    assert {"valid", Reason.MALFORMED, Reason.BODY} <= set(outcomes)
