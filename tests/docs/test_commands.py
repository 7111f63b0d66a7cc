"""Every command that a page or a table of results names can be given today: script, module, verb and options exist."""

from __future__ import annotations

import importlib.util
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer

from tests.docs.test_pages import FILES, ROOT
from trocar.services.cli.app import add_installed_verbs, app

RESULTS = ROOT / "benchmarks" / "results"
PAGES = [*FILES, ROOT / "CONTRIBUTING.md", *sorted(RESULTS.rglob("*.md")), *sorted(RESULTS.glob("*.json"))]
#: A command ends with its line or code, or where a shell, a comment or the quote of JSON goes on.
_COMMAND = re.compile(r"(?:^ *(?:\$ )?|`|command\"?: \"?)((?:python|trocar) [^`\"\n|;&#>)]+)", re.MULTILINE)
_OPTION = re.compile(r"--[a-z][a-z-]*")
#: Made by who follows the recipe that names it.
_MADE = {"docs/examples/watch_tip.py"}
add_installed_verbs()
_TREE: Any = typer.main.get_command(app)


def file_of_module(name: str) -> Path | None:
    """Return the file that ``python -m NAME`` runs, None if it is none of ours."""
    places = [ROOT.joinpath(*each.split(".")) for each in (name, name.removeprefix("trocar."))]
    files = [file for place in places for file in (place.with_suffix(".py"), place / "__main__.py")]
    return next((file for file in files if file.is_file()), None)


def options_of(words: list[str]) -> list[str]:
    return [found[0] for found in map(_OPTION.match, words) if found]


def faults_of_script(file: Path, options: list[str]) -> Iterator[str]:
    """Yield the options that a benchmark does not take; some hand those that they do not know to `trocar up`."""
    text = file.read_text(encoding="utf-8")
    if file.parent.name == "benchmarks" and "parse_known_args" not in text:
        for option in options:
            declared = re.compile(rf"\"{option}\"|\b{option[2:].replace('-', '_')}=\(")
            if not declared.search(text):
                yield f"{file.name} takes no {option}"


def faults_of_python(words: list[str]) -> Iterator[str]:
    if words[0] == "-m" and len(words) > 1:
        file, package = file_of_module(words[1]), words[1].partition(".")[0]
        if file is None and (package == "trocar" or importlib.util.find_spec(package) is None):
            yield f"there is no module {words[1]}"
    else:
        file = ROOT / words[0] if words[0].endswith(".py") and words[0] not in _MADE else None
    if file is not None and not file.is_file():
        yield f"there is no {file.relative_to(ROOT)}"
    elif file is not None:
        yield from faults_of_script(file, options_of(words))


def faults_of_trocar(words: list[str]) -> Iterator[str]:
    verb, said = _TREE, "trocar"
    while words and hasattr(verb, "commands") and re.fullmatch(r"[a-z][a-z-]*", words[0]):
        said = f"{said} {words[0]}"
        if words[0] not in verb.commands:
            yield f"there is no `{said}`"
            return
        verb, words = verb.commands[words[0]], words[1:]
    known = {name for each in verb.params for name in (*each.opts, *each.secondary_opts)} | {"--help"}
    yield from (f"`{said}` takes no {option}" for option in options_of(words) if option not in known)


def faults(text: str) -> list[str]:
    """Return what is wrong with the commands in a text, a sentence each."""
    judges = {"python": faults_of_python, "trocar": faults_of_trocar}
    commands = [found.split() for found in _COMMAND.findall(text)]
    return [fault for name, *words in commands if words for fault in judges[name](words)]


@pytest.mark.parametrize("page", PAGES, ids=[str(page.relative_to(ROOT)) for page in PAGES])
def test_commands_that_a_page_names_can_be_given(page: Path) -> None:
    assert faults(page.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("python benchmarks/bench_ladder.py --runs 3", "there is no benchmarks/bench_ladder.py"),
        ("python benchmarks/bench_chain.py --rungs 3", "bench_chain.py takes no --rungs"),
        ("python -m trocar.services.observers", "there is no module trocar.services.observers"),
        ("it is seen by `trocar observe`", "there is no `trocar observe`"),
        ("trocar doctor --all", "`trocar doctor` takes no --all"),
        ("trocar diagnose top --all", "`trocar diagnose top` takes no --all"),
    ],
)
def test_a_command_that_cannot_be_given_is_found(command: str, said: str) -> None:
    assert faults(command) == [said]


def test_a_table_says_by_which_command_it_was_made() -> None:
    told = [json.loads(page.read_text(encoding="utf-8")) for page in RESULTS.glob("*.json")]
    commands = [each["run"]["command"] for each in told if "run" in each]
    assert len(commands) > 20
    assert [each for each in commands if not re.match(r"python (-m )?benchmarks", each)] == []
