"""Refusals of files, in one form for all kinds: what is written, and the one sentence that says what is wrong where."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from trocar.services.runtime.errors import ConfigError


def assert_refused(load: Callable[[Path], object], file: Path, text: str | bytes, sentence: str) -> None:
    """Write a file, and find that it is refused by a single line that holds the pattern."""
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ConfigError, match=sentence) as caught:
        load(file)
    assert "\n" not in str(caught.value)
