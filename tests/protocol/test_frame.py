"""The envelope and the check of bodies: what is sent arrives, and what is wrong has a named reason."""

from __future__ import annotations

import math

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


def _reason(data: bytes, expected: str | None = None) -> Reason:
    with pytest.raises(FrameError) as caught:
        decode(data, expected)
    return caught.value.reason


def _changed(name: str, **changes: object) -> bytes:
    frame = samples.frame(name)
    return encode(msgspec.structs.replace(frame, body=msgspec.structs.replace(frame.body, **changes)))


def _enveloped(**changes: object) -> bytes:
    return encode(msgspec.structs.replace(samples.frame("gateway.state"), **changes))


def test_each_refusal_has_its_reason() -> None:
    good = encode(samples.frame("gateway.state"))
    assert _reason(b"\x00" * (MAX_FRAME_BYTES + 1)) is Reason.TOO_LARGE
    assert _reason(b"") is Reason.MALFORMED
    assert _reason(good[:-3]) is Reason.MALFORMED
    assert _reason(b"\xdd\xff\xff\xff\xff") is Reason.MALFORMED
    assert _reason(_enveloped(protocol=2)) is Reason.PROTOCOL_VERSION
    assert _reason(_enveloped(topic="gateway.coffee")) is Reason.UNKNOWN_TOPIC
    assert _reason(good, "physics.state") is Reason.WRONG_TOPIC
    assert _reason(_enveloped(version=TOPICS["gateway.state"].version + 1)) is Reason.NEWER_VERSION
    assert _reason(_enveloped(body=["x"])) is Reason.BODY


def test_a_body_that_is_too_short_is_refused() -> None:
    frame = samples.frame("haptics.contact_model")
    plain = msgpack.unpackb(encode(frame))
    plain[8] = plain[8][:1]
    assert _reason(msgpack.packb(plain)) is Reason.BODY


def test_a_vector_of_the_wrong_length_is_refused() -> None:
    plain = msgpack.unpackb(encode(samples.frame("gateway.state")))
    plain[8][1][0][1] = [0.0, 0.0]
    assert _reason(msgpack.packb(plain)) is Reason.BODY


def test_fields_of_a_newer_minor_are_skipped() -> None:
    """Additive fields keep the version: an older reader ignores what it does not know."""
    frame = samples.frame("haptics.contact_model")
    plain = msgpack.unpackb(encode(frame))
    plain[8].append("from the future")
    assert decode(msgpack.packb(plain)) == frame


def test_arrays_that_lie_are_refused() -> None:
    q = pack(np.zeros(4))
    rate = pack(np.zeros(4))
    state = samples.physics_state()
    for field, lie, reason in [
        ("q", Array("<f4", (4,), b"\0" * 16), Reason.ARRAY_DTYPE),
        ("q", Array("|O8", (4,), b"\0" * 32), Reason.ARRAY_DTYPE),
        ("q", Array("<f8", (4,), b"\0" * 24), Reason.ARRAY_SHAPE),
        ("q", Array("<f8", (2, 2), b"\0" * 32), Reason.ARRAY_SHAPE),
        ("q", Array("<f8", (5,), b"\0" * 40), Reason.ARRAY_SHAPE),
        ("q", Array("<f8", (-1,), b""), Reason.ARRAY_SHAPE),
        ("q", Array("<f8", (1 << 40,), b""), Reason.ARRAY_SHAPE),
        ("q", pack(np.array([0, math.nan, 0, 0])), Reason.NOT_FINITE),
    ]:
        duct = msgspec.structs.replace(state.duct, **({"q": q, "q_rate": rate} | {field: lie}))
        assert _reason(_changed("physics.state", duct=duct)) is reason, lie


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_command_with_a_number_that_is_none_is_refused(bad: float) -> None:
    model = bodies.LocalModel(force_n=(0.0, bad, 0.0))
    assert (
        _reason(_changed("haptics.contact_model", models=bodies.ContactModel.of(5, 0.02, (model,)).models))
        is Reason.NOT_FINITE
    )
    model = bodies.LocalModel(grasp_torque_nm=bad)
    assert (
        _reason(_changed("haptics.contact_model", models=bodies.ContactModel.of(5, 0.02, (model,)).models))
        is Reason.NOT_FINITE
    )


def test_opposite_infinities_do_not_cancel() -> None:
    model = bodies.LocalModel(force_n=(math.inf, -math.inf, 0.0))
    assert (
        _reason(_changed("haptics.contact_model", models=bodies.ContactModel.of(5, 0.02, (model,)).models))
        is Reason.NOT_FINITE
    )


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
