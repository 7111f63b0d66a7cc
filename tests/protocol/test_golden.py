"""Bytes of every version that ever travelled still decode. A file here is never edited: a new version adds one.

``python -m tests.protocol.test_golden`` writes the files that are missing.
"""

from __future__ import annotations

from pathlib import Path

import msgpack
import pytest

from tests.protocol import samples
from trocar.protocol import TOPICS, FrameError, Reason, decode, encode

GOLDEN = Path(__file__).parent / "golden"


def _file(name: str) -> Path:
    return GOLDEN / f"{name}.v{TOPICS[name].version}.msgpack"


@pytest.mark.parametrize("name", TOPICS)
def test_the_current_version_is_frozen(name: str) -> None:
    now, frozen = (msgpack.unpackb(data, strict_map_key=False) for data in (encode(samples.frame(name)), _golden(name)))
    assert _extends(now, frozen), (
        f"{name}: the bytes changed. A new field goes at the end with a default; anything else is a new version"
    )


def _golden(name: str) -> bytes:
    return _file(name).read_bytes()


def _extends(now: object, frozen: object) -> bool:
    """Whether arrays have kept what they had at each place, and only grew at the end."""
    if isinstance(now, list) and isinstance(frozen, list):
        return len(now) >= len(frozen) and all(map(_extends, now, frozen))
    return now == frozen


def test_a_field_that_moves_goes_or_changes_is_seen() -> None:
    frozen = [1, [2.0, [3, b"4"]]]
    assert _extends([1, [2.0, [3, b"4", 5]], 6], frozen)
    for changed in ([1, [[3, b"4"], 2.0]], [1, [2.0, [3]]], [1, [2.0, [3, b"5"]]], [2.0, [3, b"4"]]):
        assert not _extends(changed, frozen)


@pytest.mark.parametrize("path", sorted(GOLDEN.glob("*.msgpack")), ids=lambda path: path.stem)
def test_every_version_is_still_understood_and_what_has_gone_is_refused(path: Path) -> None:
    """A new topic cannot take the name of one that has gone: it would not understand the bytes that lie here."""
    name = path.stem.rpartition(".v")[0]
    if name in TOPICS:
        assert isinstance(decode(path.read_bytes(), name).body, TOPICS[name].body)
        return
    with pytest.raises(FrameError) as caught:
        decode(path.read_bytes())
    assert caught.value.reason is Reason.UNKNOWN_TOPIC


if __name__ == "__main__":
    for topic_name in TOPICS:
        if not _file(topic_name).exists():
            _file(topic_name).write_bytes(encode(samples.frame(topic_name)))
