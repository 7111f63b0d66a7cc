"""A misspelt option of `trocar up` is named, with the nearest known word, before anything is started or made."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.cli.conftest import Trocar
from trocar.services.cli import check_options, validation
from trocar.services.messages.nearest_word import did_you_mean
from trocar.services.runtime.errors import ConfigError


@pytest.fixture
def short_path() -> Iterator[Path]:
    """A folder whose name leaves room for a socket's: the system allows 107 characters."""
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder)


@pytest.mark.parametrize(
    ("arguments", "option", "nearest"),
    [
        (("--rig", "stubb"), "--rig stubb", "stub"),
        (("--scene", "defalt"), "--scene defalt", "default"),
        (("--set", "duct.n_mods=40"), "--set duct.n_mods=40", "n_modes"),
    ],
)
def test_a_misspelt_option_is_named_and_leaves_nothing(
    trocar: Trocar, short_path: Path, arguments: tuple[str, ...], option: str, nearest: str
) -> None:
    made = {"transport.directory": short_path / "bus", "recorder.directory": short_path / "recordings"}
    sound = [word for key, path in made.items() for word in ("--set", f"{key}={path}")]
    ran = trocar("up", *sound, *arguments, "--seconds", "1")
    assert ran.code == 2
    assert ran.sentence().startswith(f"{option}: ")
    assert ran.sentence().endswith(f"; did you mean '{nearest}'?")
    assert list(short_path.iterdir()) == []


def test_the_check_in_a_process_of_its_own_refuses_with_the_same_sentence_and_code(short_path: Path) -> None:
    made = f"transport.directory={short_path / 'bus'}"
    with pytest.raises(validation.RefusedError, match=r"^--rig stubb: .*; did you mean 'stub'\?$") as refused:
        validation.validate("stubb", None, (made,))
    assert refused.value.exit_code == 2
    assert list(short_path.iterdir()) == []


@pytest.mark.parametrize(
    ("override", "nearest"),
    [
        ("scene=defalt", "default"),
        ("recordr.enabled=true", "recorder"),
        ("duct.bending=dtk", "dkt"),
        ("duct.tissue=reference_dukt", "reference_duct"),
        ("effects.graviti={}", "gravity"),
        ("quality.0.iteratons=3", "iterations"),
        ("quality.0.without=[frictio]", "friction"),
        ("processes.gatewy.core=1", "gateway"),
    ],
)
def test_the_nearest_known_word_is_suggested_for_any_key_and_choice(override: str, nearest: str) -> None:
    with pytest.raises(ConfigError, match=rf"^--set {re.escape(override)}: .*; did you mean '{nearest}'\?$"):
        check_options.checked_rig("stub", None, [override])


def test_what_is_wrong_in_numbers_is_refused_before_the_start_too(trocar: Trocar, rig_file: Path) -> None:
    ran = trocar("up", "--rig", rig_file, "--set", "hands=pinch", "--set", "duct.length_m=-0.04")
    assert ran.code == 2
    assert ran.sentence().startswith("--set duct.length_m=-0.04: ")
    assert [path.name for path in rig_file.parent.iterdir()] == [rig_file.name]


def test_the_first_of_several_is_named_and_a_sound_rig_is_let() -> None:
    with pytest.raises(ConfigError, match=r"^--set duct\.n_mods=3: .*\(and 1 more\); did you mean 'n_modes'\?$"):
        check_options.checked_rig("stub", None, ["duct.radius_m=0.004", "duct.n_mods=3", "duct.lenght_m=0.1"])
    with pytest.raises(ConfigError, match=r"^--rig .*none\.yaml: there is no such rig file$"):
        check_options.checked_rig("none.yaml", "default", ())
    assert check_options.checked_rig("mouse", "pinch", ["duct.radius_m=0.004"])[0].name == "mouse"


def test_what_is_like_nothing_gets_no_suggestion() -> None:
    assert did_you_mean("mose", ["stub", "mouse"]) == "; did you mean 'mouse'?"
    assert did_you_mean("xyz", ["stub", "mouse"]) == ""
    assert did_you_mean(["probe"], []) == ""


def test_what_was_sound_is_not_checked_again_until_something_changes(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, rig_file: Path
) -> None:
    """A check takes a second and a half of a warm start of four."""
    monkeypatch.setenv("TROCAR_CACHE_DIR", str(tmp_path))
    checked: list[str] = []
    monkeypatch.setattr(validation, "_check", checked.append)
    scene = tmp_path / "scene.yaml"
    scene.write_text("duct: {n_modes: 20}\n")
    for _ in range(2):
        validation.validate(str(rig_file), str(scene), ["recorder.shared=true"])
    assert len(checked) == 1
    scene.write_text("duct: {n_modes: 30}\n")
    validation.validate(str(rig_file), str(scene), ["recorder.shared=true"])
    rig_file.write_text(rig_file.read_text() + "spare_power: true\n")
    validation.validate(str(rig_file), str(scene), ["recorder.shared=true"])
    validation.validate(str(rig_file), str(scene), [])
    assert len(checked) == 4
    scene.write_text("duct: {mesh_file: surface.stl}\n")
    for _ in range(2):
        validation.validate(str(rig_file), str(scene), [])
    assert len(checked) == 6
