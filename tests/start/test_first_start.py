"""It is told at once whether a start will compile: by a mark of the same sources, or kernels that came along."""

from __future__ import annotations

from pathlib import Path

import pytest

from trocar.services.kernels import kernel_archive
from trocar.services.start import first_start


@pytest.fixture(autouse=True)
def own_cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "kernels"))
    monkeypatch.setattr(kernel_archive, "FOLDER", tmp_path / "none")
    first_start._fingerprint.cache_clear()


def test_a_first_start_is_told_and_a_later_one_is_not() -> None:
    assert first_start.notice() == "first start: compiles for about a minute; later ones take seconds"
    first_start.leave_mark()
    assert first_start.notice() == ""


def test_the_mark_of_other_sources_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    first_start.leave_mark()
    first_start._fingerprint.cache_clear()
    monkeypatch.setattr(first_start, "target_name", lambda: "another processor")
    assert first_start.notice() == first_start.NOTICE
    first_start._fingerprint.cache_clear()


def test_kernels_that_came_along_leave_nothing_to_tell(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    folder = tmp_path / "came"
    folder.mkdir()
    monkeypatch.setattr(kernel_archive, "FOLDER", folder)
    assert first_start.notice() == first_start.NOTICE
    (folder / f"x{kernel_archive.SUFFIX}").touch()
    assert first_start.notice() == ""


@pytest.mark.parametrize("reason", ["", "the kernels were made with Python 3.12 (here 3.11)"])
def test_why_what_came_with_the_package_is_compiled_anew_is_told(monkeypatch: pytest.MonkeyPatch, reason: str) -> None:
    monkeypatch.setattr(kernel_archive, "unpack", lambda root: reason)
    assert first_start.notice_of_misfit() == (f"{first_start.NOTICE}; {reason}" if reason else "")
    first_start.leave_mark()
    assert first_start.notice_of_misfit() == ""


def test_a_cache_that_cannot_be_written_is_no_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(first_start, "_mark", lambda: Path("/proc/nowhere/complete"))
    first_start.leave_mark()
    assert first_start.notice() == first_start.NOTICE
