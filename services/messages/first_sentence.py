"""The first sentence of a text: what a list says of a thing that is described at length."""

from __future__ import annotations

import re


def first_sentence(text: str) -> str:
    """Return the first sentence of a text of several lines, on one line; a colon at a line's end ends it, too."""
    sentence = re.split(r":\s*\n|(?<=\.)\s", text.strip() + "\n", maxsplit=1)[0]
    return " ".join(sentence.split())
