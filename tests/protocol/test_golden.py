"""Bytes of every version that ever travelled still decode. A file here is never edited: a new version adds one.

``python -m tests.protocol.test_golden`` writes the files that are missing.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from protocol import TOPICS, decode, encode
from tests.protocol import samples

GOLDEN = Path(__file__).parent / "golden"


def _file(name: str) -> Path:
    return GOLDEN / f"{name}.v{TOPICS[name].version}.msgpack"


@pytest.mark.parametrize("name", TOPICS)
def test_the_current_version_is_frozen(name: str) -> None:
    assert encode(samples.frame(name)) == _file(name).read_bytes(), (
        f"{name}: the bytes changed. A new field goes at the end with a default; anything else is a new version"
    )


@pytest.mark.parametrize("path", sorted(GOLDEN.glob("*.msgpack")), ids=lambda path: path.stem)
def test_every_version_is_still_understood(path: Path) -> None:
    name = path.stem.rpartition(".v")[0]
    assert isinstance(decode(path.read_bytes(), name).body, TOPICS[name].body)


if __name__ == "__main__":
    for topic_name in TOPICS:
        if not _file(topic_name).exists():
            _file(topic_name).write_bytes(encode(samples.frame(topic_name)))
