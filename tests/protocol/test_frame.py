"""The envelope and the check of bodies: what is sent arrives, and what is wrong has a named reason."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import msgpack
import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.by_day import examples
from tests.protocol import samples, strategies
from trocar import protocol
from trocar.protocol import TOPICS, Frame, FrameError, Reason, bodies, decode, encode, peek, soundness
from trocar.protocol.arrays import Array, pack
from trocar.protocol.frame import MAX_FRAME_BYTES

numbers = st.integers(0, 2**48)


@pytest.mark.parametrize("name", TOPICS)
@settings(
    max_examples=examples(20, 200),
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
@given(data=st.data())
def test_every_body_arrives_as_it_was_sent(name: str, data: st.DataObject) -> None:
    row = TOPICS[name]
    body = data.draw(strategies.bodies(row.body))
    sent = Frame(protocol.PROTOCOL_VERSION, name, row.version, *data.draw(st.tuples(*[numbers] * 4)), True, body)
    assert decode(encode(sent), name) == sent


@pytest.mark.parametrize("name", TOPICS)
def test_any_msgpack_reads_the_same_positions(name: str) -> None:
    """The wire is plain msgpack: another language's library sees the fields where docs/reference/wire.md says."""
    frame = samples.frame(name)
    plain = msgpack.unpackb(encode(frame), strict_map_key=False)
    assert plain[:8] == [1, name, TOPICS[name].version, samples.INCARNATION, 7, 2_000, 1_000, True]
    body = frame.body
    assert len(plain[8]) == len(body.__struct_fields__)
    for value, field in zip(plain[8], body.__struct_fields__, strict=True):
        if isinstance(getattr(body, field), Array):
            dtype, shape, raw = value
            np.testing.assert_array_equal(np.frombuffer(raw, dtype).reshape(shape), getattr(body, field).view())


def test_other_packers_are_understood() -> None:
    """A frame written by msgpack itself, from plain lists, decodes to the same body."""
    frame = samples.frame("haptics.contact_model")
    assert decode(msgpack.packb(msgpack.unpackb(encode(frame)))) == frame


def _enveloped(**changes: object) -> bytes:
    return encode(msgspec.structs.replace(samples.frame("gateway.state"), **changes))


def _model(**numbers_: Any) -> bytes:
    """Return a frame with one model in which these numbers are."""
    frame = samples.frame("haptics.contact_model")
    models = bodies.ContactModel.of(5, 0.02, (bodies.LocalModel(**numbers_),)).models
    return encode(msgspec.structs.replace(frame, body=msgspec.structs.replace(frame.body, models=models)))


def _duct(q: Array) -> bytes:
    """Return a frame of physics with these coordinates of the duct beside four rates."""
    frame, state = samples.frame("physics.state"), samples.physics_state()
    duct = msgspec.structs.replace(state.duct, q=q, q_rate=pack(np.zeros(4)))
    return encode(msgspec.structs.replace(frame, body=msgspec.structs.replace(frame.body, duct=duct)))


def _plain(name: str, change: Callable[[list[Any]], None]) -> bytes:
    """Return a frame whose body another packer has changed."""
    plain = msgpack.unpackb(encode(samples.frame(name)))
    change(plain[8])
    return bytes(msgpack.packb(plain))


def _shorten_vector(body: list[Any]) -> None:
    body[1][0][1] = [0.0, 0.0]


_GOOD = encode(samples.frame("gateway.state"))
_NONE = (math.nan, math.inf, -math.inf)

#: What arrives, the reason for which it is refused, and the topic that its reader waits for, if any.
REFUSED: list[tuple[bytes, Reason, str | None]] = [
    (b"\x00" * (MAX_FRAME_BYTES + 1), Reason.TOO_LARGE, None),
    (b"", Reason.MALFORMED, None),
    (_GOOD[:-3], Reason.MALFORMED, None),
    (b"\xdd\xff\xff\xff\xff", Reason.MALFORMED, None),
    (_enveloped(protocol=2), Reason.PROTOCOL_VERSION, None),
    (_enveloped(topic="gateway.coffee"), Reason.UNKNOWN_TOPIC, None),
    (_GOOD, Reason.WRONG_TOPIC, "physics.state"),
    (_enveloped(version=TOPICS["gateway.state"].version + 1), Reason.NEWER_VERSION, None),
    (_enveloped(body=["x"]), Reason.BODY, None),
    (_plain("haptics.contact_model", lambda body: body.__delitem__(slice(1, None))), Reason.BODY, None),
    (_plain("gateway.state", _shorten_vector), Reason.BODY, None),
    # Arrays that lie.
    (_duct(Array("<f4", (4,), b"\0" * 16)), Reason.ARRAY_DTYPE, None),
    (_duct(Array("|O8", (4,), b"\0" * 32)), Reason.ARRAY_DTYPE, None),
    (_duct(Array("<f8", (4,), b"\0" * 24)), Reason.ARRAY_SHAPE, None),
    (_duct(Array("<f8", (2, 2), b"\0" * 32)), Reason.ARRAY_SHAPE, None),
    (_duct(Array("<f8", (5,), b"\0" * 40)), Reason.ARRAY_SHAPE, None),
    (_duct(Array("<f8", (-1,), b"")), Reason.ARRAY_SHAPE, None),
    (_duct(Array("<f8", (1 << 40,), b"")), Reason.ARRAY_SHAPE, None),
    (_duct(pack(np.array([0, math.nan, 0, 0]))), Reason.NOT_FINITE, None),
    # Numbers that are none; opposite infinities do not cancel.
    *((_model(force_n=(0.0, bad, 0.0)), Reason.NOT_FINITE, None) for bad in _NONE),
    *((_model(grasp_torque_nm=bad), Reason.NOT_FINITE, None) for bad in _NONE),
    (_model(force_n=(math.inf, -math.inf, 0.0)), Reason.NOT_FINITE, None),
]


@pytest.mark.parametrize(
    ("data", "reason", "expected"), REFUSED, ids=[f"{k}-{reason}" for k, (_, reason, _) in enumerate(REFUSED)]
)
def test_each_refusal_has_its_reason(data: bytes, reason: Reason, expected: str | None) -> None:
    with pytest.raises(FrameError) as caught:
        decode(data, expected)
    assert caught.value.reason is reason


def test_the_frames_that_are_spoilt_for_refusals_are_sound_before() -> None:
    decode(_duct(pack(np.zeros(4))))
    decode(_model(force_n=(0.0, 1.0, 0.0)))
    decode(_plain("gateway.state", lambda _: None))


def test_fields_of_a_newer_minor_are_skipped() -> None:
    """Additive fields keep the version: an older reader ignores what it does not know."""
    frame = samples.frame("haptics.contact_model")
    plain = msgpack.unpackb(encode(frame))
    plain[8].append("from the future")
    assert decode(msgpack.packb(plain)) == frame


def test_a_header_can_be_read_alone() -> None:
    header = peek(encode(samples.frame("physics.state")))
    assert (header.topic, header.sequence, header.origin_ns) == ("physics.state", 7, 1_000)


def test_decoded_arrays_cannot_be_written() -> None:
    frame = decode(encode(samples.frame("physics.state")))
    with pytest.raises(ValueError, match="read-only"):
        frame.body.duct.q.view()[0] = 1.0


@pytest.mark.parametrize("name", ["gateway.state", "physics.state"])
def test_who_only_keeps_a_frame_gets_it_with_numbers_that_are_none_but_never_with_arrays_that_lie(name: str) -> None:
    """A recording shows what went wrong; but what could not be read back is refused for everybody."""
    frame = samples.frame(name)
    if name == "gateway.state":
        broken = msgspec.structs.replace(frame.body.instruments[0], handle_angle_rad=math.nan)
        body = msgspec.structs.replace(frame.body, instruments=(broken,))
    else:
        q = pack(np.full(frame.body.duct.q.shape, math.nan))
        body = msgspec.structs.replace(frame.body, duct=msgspec.structs.replace(frame.body.duct, q=q))
    data = encode(msgspec.structs.replace(frame, body=body))
    with pytest.raises(FrameError, match="not_finite"):
        decode(data, name)
    assert decode(data, name, used=False).sequence == frame.sequence
    if name == "physics.state":
        duct = msgspec.structs.replace(frame.body.duct, q=Array("<f8", (7,), b"short"))
        data = encode(msgspec.structs.replace(frame, body=msgspec.structs.replace(frame.body, duct=duct)))
        with pytest.raises(FrameError, match="array_shape"):
            decode(data, name, used=False)


@pytest.mark.parametrize("n", range(9))
def test_a_body_must_pass_every_check_however_many_there_are(n: int) -> None:
    """They are asked a few at a time, each once, up to the first that fails."""
    for failing in range(n + 1):
        asked: list[int] = []

        def check(i: int, asked: list[int] = asked, failing: int = failing) -> soundness.Check:
            return lambda body: asked.append(i) or i != failing

        assert soundness._all_of([check(i) for i in range(n)])(None) is (failing == n)
        assert asked == list(range(min(failing + 1, n)))
