"""What a new user asks the command for: which scenes and studies there are, whose run is shown, where a report goes."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from tests.cli.conftest import Trocar
from trocar.services.cli import targets
from trocar.services.messages.first_sentence import first_sentence
from trocar.services.runtime.config import config
from trocar.services.runtime.errors import ConfigError
from trocar.services.runtime.measures.flights import FILE_SUFFIX, Flights, to_bytes
from trocar.studies.accuracy.study import study_names


def test_every_scene_is_listed_with_a_sentence(trocar: Trocar) -> None:
    ran = trocar("scenes", "--json")
    said = json.loads(ran.out)["scenes"]
    assert list(said) == sorted(path.stem for path in config.config_directory().glob("scenes/*.yaml"))
    assert all(10 < len(sentence) < 300 and "\n" not in sentence for sentence in said.values())
    assert said["stone"] == "A stone lies in the way of the catheter, which pushes it on."
    assert re.search("^stone +A stone lies in the way of the catheter", trocar("scenes").out, re.MULTILINE)


def test_a_scene_without_a_comment_is_listed(trocar: Trocar, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "scenes").mkdir()
    (tmp_path / "scenes" / "bare.yaml").write_text("duct: {}\n# A comment further down.\n")
    monkeypatch.setenv("TROCAR_CONFIG_DIR", str(tmp_path))
    assert json.loads(trocar("scenes", "--json").out) == {"scenes": {"bare": ""}}


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("One thing. Another.", "One thing."),
        ("A duct of 4.5 mm:\n  trocar up", "A duct of 4.5 mm"),
        ("The insertion: a duct\nand a catheter. Two.", "The insertion: a duct and a catheter."),
        ("No end", "No end"),
        ("", ""),
    ],
)
def test_first_sentence(text: str, sentence: str) -> None:
    assert first_sentence(text) == sentence


def test_studies_are_listed_without_a_name(trocar: Trocar, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    ran = trocar("study", "--json")
    assert (ran.code, ran.err) == (0, "")
    said = json.loads(ran.out)["studies"]
    assert list(said) == study_names()
    assert all(sentence.endswith(".") for sentence in said.values())
    assert "Segments of the insertion's catheter" in trocar("study").out
    assert list(tmp_path.iterdir()) == []


def test_a_misspelt_study_and_family_are_told_the_nearest(trocar: Trocar) -> None:
    assert trocar("study", "elemnt").sentence().endswith("; did you mean 'element'?")
    assert trocar("stability", "--family", "undampd").sentence().endswith("; did you mean 'undamped'?")
    assert trocar("sniff", "gateway.stat").sentence().endswith("; did you mean 'gateway.state'?")


def test_a_misspelt_verb_or_option_is_told_the_nearest(trocar: Trocar) -> None:
    assert "did you mean 'up'" in trocar("upp").err
    assert "did you mean 'show'" in trocar("config", "shwo").err
    assert "--scene" in trocar("up", "--sene", "default").err


def test_the_folder_of_a_report_is_made(tmp_path: Path) -> None:
    targets.look_at_file("--report", tmp_path / "a" / "b" / "page.md", makes_folder=True)
    assert (tmp_path / "a" / "b").is_dir()
    (tmp_path / "file").touch()
    with pytest.raises(ConfigError, match=r"^--report .*/file: is a file, not a folder$"):
        targets.look_at_file("--report", tmp_path / "file" / "page.md", makes_folder=True)


@pytest.mark.parametrize(
    "command",
    [("stability", "--family", "undamped"), ("study", "element", "--smallest")],
)
def test_a_report_goes_where_there_was_no_folder(
    trocar: Trocar, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: tuple[str, ...]
) -> None:
    """Refused for something else, after the report's folder was looked at: nothing is run here."""
    (tmp_path / "out").touch()
    ran = trocar(*command, "--report", tmp_path / "reports" / "page.md", "--out", tmp_path / "out")
    assert (ran.code, ran.sentence()) == (2, f"--out {tmp_path / 'out'}: is a file, not a folder")
    assert (tmp_path / "reports").is_dir()


def test_latency_without_a_rig_says_whose_run_it_shows(trocar: Trocar, rig_file: Path) -> None:
    folder = rig_file.parent / "flights"
    folder.mkdir(mode=0o700)
    kept = folder / f"late{FILE_SUFFIX}"
    kept.write_bytes(to_bytes(Flights((), 0, "2026-11-20T10:00:00+00:00", "physics was late", ())))
    ran = trocar("latency", "--rig", rig_file)
    assert (ran.code, ran.err) == (0, "")
    first = ran.out.splitlines()[0]
    assert first == f"No rig runs as {rig_file}; this is the last that one kept, at 2026-11-20T10:00:00+00:00: {kept}"
    (told,) = json.loads(trocar("latency", "--rig", rig_file, "--json").out)
    assert told["file"] == str(kept)
