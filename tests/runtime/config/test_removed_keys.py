"""A rig file that names a removed key opens as before, and one sentence says that the key does nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

from trocar.services.cli.check_options import checked_rig
from trocar.services.runtime.config import config
from trocar.services.runtime.config.removed_keys import REMOVED_RIG_KEYS


@pytest.mark.parametrize("key", REMOVED_RIG_KEYS)
@pytest.mark.parametrize("by", ["file", "option"])
def test_a_removed_key_is_named_once_and_changes_nothing(
    key: str, by: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.delenv("TROCAR_REMOVED_KEYS_TOLD", raising=False)
    *parents, last = key.split(".")
    text = "".join(f"{'  ' * k}{name}:\n" for k, name in enumerate(parents)) + f"{'  ' * len(parents)}{last}: [nice]\n"
    file = tmp_path / "old.yaml"
    file.write_text(f"base: stub\nname: old\n{text if by == 'file' else ''}")
    overrides = [f"{key}=[nice]"] if by == "option" else []
    rig = config.load_rig(file, overrides)
    assert rig == config.load_rig(file, overrides)
    (sentence,) = [record.getMessage() for record in caplog.records]
    assert "old.yaml" in sentence
    assert f"{key}: this key was removed and has no effect" in sentence
    monkeypatch.delenv("TROCAR_REMOVED_KEYS_TOLD")


@pytest.mark.parametrize("key", REMOVED_RIG_KEYS)
def test_a_verb_takes_an_option_with_a_removed_key(key: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TROCAR_REMOVED_KEYS_TOLD", " ".join(REMOVED_RIG_KEYS))
    assert checked_rig("stub", None, [f"{key}=[nice]"])[0] == checked_rig("stub", None, [])[0]
