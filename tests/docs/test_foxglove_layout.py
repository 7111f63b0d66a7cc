"""The layout for Foxglove in docs/examples: whatever it shows is in a recording, by the schemas in the file."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

from google.protobuf.descriptor import Descriptor
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from tests.made_samples import SUCCESS

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"


def words(part: object) -> Iterator[str]:
    """Yield all keys and texts of a layout."""
    if isinstance(part, dict):
        yield from part
        part = list(part.values())
    if isinstance(part, list):
        for each in part:
            yield from words(each)
    if isinstance(part, str):
        yield part


def test_its_topics_and_fields_are_those_of_a_recording() -> None:
    with SUCCESS.open("rb") as file:
        messages = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
        found: dict[str, Descriptor] = {channel.topic: body.DESCRIPTOR for _, channel, _, body in messages}
    layout = json.loads((EXAMPLES / "foxglove-layout.json").read_text())
    shown = {word for word in words(layout) if word.startswith("/")}
    assert len(shown) > 3
    assert any("." in each for each in shown)
    for each in shown:
        topic, *path = each.split(".")
        assert topic in found, each
        fields: Descriptor | None = found[topic]
        for name in path:
            assert fields is not None, each
            field = fields.fields_by_name.get(re.sub(r"\[.*\]|\.@.*", "", name))
            assert field is not None, each
            fields = field.message_type
