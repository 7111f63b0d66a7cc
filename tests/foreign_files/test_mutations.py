"""Changed files of every kind through the reader: no process dies, none takes much, every refusal is a sentence."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.foreign_files.mutations import Findings, campaign, try_recording, try_surface
from tests.foreign_files.whole_files import recordings, surfaces

pytest.importorskip("vtkmodules", reason="the mesh extra is not installed")

_WHOLES: dict[str, tuple[Callable[[Path], dict[str, bytes]], Callable[[Path, Findings], None]]] = {
    "surfaces": (lambda _folder: surfaces(), try_surface),
    "recordings": (recordings, try_recording),
}


@pytest.mark.parametrize("kind", _WHOLES)
@pytest.mark.parametrize("n", [50, pytest.param(5000, marks=[pytest.mark.long, pytest.mark.timeout(7200)])])
def test_a_file_that_was_changed_is_read_or_refused_in_a_sentence(tmp_path: Path, kind: str, n: int) -> None:
    make, attempt = _WHOLES[kind]
    wholes = make(tmp_path)
    found = campaign(wholes, attempt, n, tmp_path, seed=n)
    assert found.tried == n
    assert found.refused.total() > n // 3, "so few changes show nothing"
    print(found)
