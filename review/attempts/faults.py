"""Keeps the supervisor's sentences about a late rig, each once: sentences that differ only in numbers are one."""

from __future__ import annotations

import re
from collections.abc import Sequence

_NUMBER = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?![\w.]*\w)")
_FEW = 3
"""Up to so many values are named, of more the least and the largest."""


class FaultLog:
    """Takes what is said, time and again; only what changes is said anew."""

    def __init__(self) -> None:
        self._last = ""
        self._said: dict[str, list[Sequence[str]]] = {}

    def take_sentence(self, sentence: str) -> None:
        """Take what is said now; empty if nothing is."""
        if sentence and sentence != self._last:
            owner, colon, rest = sentence.rpartition(": ")
            form = f"{owner}{colon}{_NUMBER.sub(chr(0), rest)}"
            self._said.setdefault(form, []).append(_NUMBER.findall(rest))
        self._last = sentence

    def sentences(self) -> tuple[str, ...]:
        """Return each form of a sentence once, with the values that it was said with, and how often."""
        return tuple(_filled(form, said) for form, said in self._said.items())


def _filled(form: str, said: Sequence[Sequence[str]]) -> str:
    words = form.split(chr(0))
    values = [_together(column) for column in zip(*said, strict=True)]
    text = "".join(f"{word}{value}" for word, value in zip(words, [*values, ""], strict=True))
    return text if len(said) == 1 else f"{text} (said {len(said)} times)"


def _together(values: Sequence[str]) -> str:
    known = sorted(set(values), key=float)
    return ", ".join(known) if len(known) <= _FEW else f"{known[0]} to {known[-1]}"
