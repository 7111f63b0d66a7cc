"""Plain msgpack reads every golden frame and names its fields."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

import trocar.protocol.bodies as bodies
from tests.protocol import samples
from trocar import protocol
from trocar.protocol import TOPICS, Frame, topic
from trocar.protocol.arrays import pack
from trocar.protocol.bodies.physics import REACTION_COLUMNS
from trocar.protocol.former import ContactModel2
from trocar.protocol.upgrades import body_type
from trocar.services.cli.diagnose.raw_frames import unpack

GOLDEN = sorted((Path(__file__).parents[2] / "protocol" / "golden").glob("*.msgpack"))


@pytest.mark.parametrize("path", GOLDEN, ids=lambda path: path.stem)
def test_every_golden_frame_is_named(path: Path) -> None:
    frame = unpack(path.read_bytes())
    if frame["topic"] not in TOPICS:  # it has gone: its fields have no names any more
        assert isinstance(frame["body"], list)
        return
    row = topic(frame["topic"])
    assert (frame["incarnation"], frame["sequence"]) == (samples.INCARNATION, 7)
    body = body_type(row, frame["version"])
    assert body is not None
    assert tuple(frame["body"]) == body.__struct_fields__[: len(frame["body"])]


def test_an_old_version_is_shown_by_its_own_names() -> None:
    model = bodies.LocalModel(force_n=(1.0, 2.0, 3.0))
    body = ContactModel2(tick=5, ttl_s=0.02, instruments=(model,))
    old = msgspec.msgpack.encode([1, "haptics.contact_model", 2, 2, 3, 4, 5, True, body])
    assert unpack(old)["body"]["instruments"][0]["force_n"] == [1.0, 2.0, 3.0]


def test_nested_structs_and_arrays() -> None:
    tool = bodies.ToolReaction(force_n=(1.0, 2.0, 3.0), contacts=2)
    contacts = bodies.ContactForces(
        kind=pack(np.zeros(20), "|i1"), point_m=pack(np.ones((20, 3))), force_n=pack(np.arange(60.0).reshape(20, 3))
    )
    body = samples.physics_state(5, tool, tool, contacts=contacts)
    data = protocol.encode(Frame(1, "physics.state", 2, 2, 3, 4, 5, True, body))
    shown = unpack(data)
    assert shown["sent_ns"] == 4
    assert shown["body"]["tools"]["shape"] == [2, REACTION_COLUMNS]
    assert shown["body"]["tools"]["first"] == [1.0, 2.0, 3.0]
    assert shown["body"]["duct"]["basis_hash"] == "c0ffee"
    assert shown["body"]["contacts"]["force_n"] == {
        "dtype": "<f8", "shape": [20, 3], "first": [0.0, 1.0, 2.0], "min": 0.0, "max": 59.0,
    }  # fmt: skip


def test_optional_struct() -> None:
    body = bodies.Health(process="physics", pid=1, state="starting")
    shown = unpack(protocol.encode(Frame(1, "physics.health", 1, 2, 3, 4, 5, True, body)))
    assert shown["body"]["loop"] is None
    assert shown["body"]["state"] == "starting"


def test_unknown_topic_and_newer_body_are_still_shown() -> None:
    stranger = msgspec.msgpack.encode([1, "some.topic", 9, 2, 3, 4, 5, True, [1, "x"]])
    assert unpack(stranger)["body"] == [1, "x"]
    newer = msgspec.msgpack.encode([1, "gateway.state", 2, 2, 3, 4, 5, True, [7, [], "a new field"]])
    assert unpack(newer)["body"]["tick"] == 7


@pytest.mark.parametrize("data", [b"", b"\xc1", b"\x93\x01", b"nonsense", msgspec.msgpack.encode({"a": 1})])
def test_what_is_no_frame_is_a_sentence(data: bytes) -> None:
    with pytest.raises(ValueError, match=r"msgpack|not an array"):
        unpack(data)


def test_an_array_that_lies_is_shown_as_bytes() -> None:
    lie = msgspec.msgpack.encode([1, "haptics.journal", 1, 2, 3, 4, 5, True, [5, ["|i1", [9], b"12"]]])
    body = unpack(lie)["body"]
    assert body["runs"] == {"dtype": "|i1", "shape": [9], "bytes": 2}


@pytest.mark.parametrize(
    "stranger", [[], [1, [2], b""], ["<f8", 3, b""], ["<f8", ["x"], b""], ["<f8", [1], b"", 1], [[1]]]
)
def test_what_is_no_array_is_shown_as_it_came(stranger: list[object]) -> None:
    frame = msgspec.msgpack.encode([1, "haptics.contact_model", 3, 2, 3, 4, 5, True, [5, 0.02, stranger]])
    assert unpack(frame)["body"]["models"] == stranger
