"""The file of a class: what is refused, and in which words."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.refusals import assert_refused
from trocar.review.classroom.roll import load_roll
from trocar.services.runtime.errors import ConfigError

_RIG = '[[rig]]\nname = "a"\naddress = "http://192.168.1.11:8080/"\n'
_TOKEN = 'token = "sixteen characters at least"\n'


def test_a_class_is_read(tmp_path: Path) -> None:
    file = tmp_path / "class.toml"
    file.write_text(f'{_TOKEN}{_RIG}trainee = "heron-17"\n')
    roll = load_roll(file)
    assert (roll.rig[0].address, roll.rig[0].trainee) == ("http://192.168.1.11:8080", "heron-17")


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (_RIG, "token: this key is missing"),
        (f'token = "short"\n{_RIG}', "token: string should have at least 16"),
        (_TOKEN, "rig: this key is missing"),
        (f"{_TOKEN}rig = []\n", "rig: tuple should have at least 1"),
        (f"{_TOKEN}{_RIG}{_RIG}", "two rigs are called 'a'"),
        (f"{_TOKEN}{_RIG.replace('http:', 'file:')}", "is no page of a rig"),
        (f"{_TOKEN}{_RIG.replace('8080/', '8080/api')}", "is no page of a rig"),
        (f"{_TOKEN}{_RIG}seat = 3\n", "rig.0.seat: unknown key 'seat'; known: address, fingerprint, name, trainee"),
        (f"{_TOKEN}{_RIG}fingerprint = 'AB:CD'\n", "rig.0.fingerprint: 'AB:CD' is no fingerprint"),
        (f"{_TOKEN}rig = 7\n", "rig: input should be a valid array"),
        ("token = ", "Invalid value"),
        ("\udc80", "is not UTF-8 text$"),
    ],
)
def test_a_mistake_in_a_class_is_one_sentence(tmp_path: Path, text: str, why: str) -> None:
    data = text.encode("utf-8", "surrogateescape")
    assert_refused(load_roll, tmp_path / "class.toml", data, f"class.toml: .*{why}")


def test_no_file_is_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"class.toml: No such file or directory$"):
        load_roll(tmp_path / "class.toml")


def test_the_example_is_a_class() -> None:
    roll = load_roll(Path(__file__).resolve().parents[2] / "deploy" / "class.example.toml")
    assert [place.trainee for place in roll.rig] == ["heron-17", "magpie-2", "starling-5"]
