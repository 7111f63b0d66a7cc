"""The cache that tests keep from run to run: named by all code that fills it, and bounded."""

from __future__ import annotations

import os
import re
import time
from pathlib import Path

import pytest

from tests import conftest

ROOT = Path(__file__).parents[2]


def test_every_module_that_makes_entries_names_the_folder() -> None:
    makers = {
        ".".join(("trocar", *path.relative_to(ROOT).with_suffix("").parts))
        for path in (ROOT / "services").rglob("*.py")
        if re.search(r"(?<!def )\bentry_name\(", path.read_text(encoding="utf-8"))
    }
    assert makers == set(conftest.MAKERS)


def test_changed_code_has_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = conftest.kept_directory(tmp_path)
    assert conftest.kept_directory(tmp_path) == before
    monkeypatch.setattr(conftest.Sources, "digest", lambda self, module: f"{module} after an edit")
    assert conftest.kept_directory(tmp_path) != before


def test_the_last_used_few_are_kept_and_what_may_be_in_use(tmp_path: Path) -> None:
    old, new = ([tmp_path / f"{age}-{k}" for k in range(5)] for age in ("old", "new"))
    for path in (*old, *new):
        path.mkdir()
    for path in old:
        os.utime(path, (time.time() - 1e6,) * 2)
    mine = conftest.kept_directory(tmp_path)
    assert set(tmp_path.iterdir()) == {mine, *new}
