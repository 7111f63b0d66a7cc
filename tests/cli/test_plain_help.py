"""Help shows each text as it is written: brackets in it are no markup of the terminal."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import pytest
import typer
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from trocar.services.cli.app import add_installed_verbs, app
from trocar.services.cli.plain_help import PlainTyper

_WIDE = {"COLUMNS": "400", "TERMINAL_WIDTH": "400", "NO_COLOR": "1"}


def shown(which: typer.Typer, *words: str) -> str:
    """Return what `--help` shows, without the lines of its boxes, spaces as one."""
    result = CliRunner().invoke(which, [*words, "--help"], env=_WIDE, catch_exceptions=False)
    assert result.exit_code == 0
    return re.sub(r"[\s│╭╮╰╯─]+", " ", result.output)


def verbs(command: Any, *words: str) -> Iterator[tuple[tuple[str, ...], Any]]:
    if not hasattr(command, "commands"):
        yield words, command
        return
    for word, inner in command.commands.items():
        yield from verbs(inner, *words, word)


def test_every_help_text_of_every_verb_is_shown_whole() -> None:
    add_installed_verbs()
    every = list(verbs(typer.main.get_command(app)))
    assert ("classroom",) in [words for words, _ in every]
    for words, verb in every:
        told = shown(app, *words)
        for text in [verb.help, *(getattr(each, "help", None) for each in verb.params)]:
            assert re.sub(r"\s+", " ", text or "").strip() in told, f"{words}: {text}"


@pytest.mark.parametrize(
    "text", ["of each `[[rig]]` `name`", "[bold]x[/bold]", "a[0] [/] [/b]", r"\[x] [red", "[1, 2]"]
)
def test_brackets_are_shown(text: str) -> None:
    assert text in shown(made(text))


@given(st.text("[]/ab=#@ `", min_size=1, max_size=30).map(lambda text: f"x{' '.join(text.split())}y"))
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_whatever_is_in_brackets_is_shown(text: str) -> None:
    assert text in shown(made(text))


def made(text: str) -> typer.Typer:
    """Return a command with a text on its option and its argument."""
    which = PlainTyper()

    def verb(what: str = typer.Argument("", help=text), more: str = typer.Option("", help=text)) -> None:
        pass

    which.command(help=text)(verb)
    return which
