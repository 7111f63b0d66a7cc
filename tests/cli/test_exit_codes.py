"""Exit codes: each stands in the table, and a file that is not there has the same one in every verb."""

from __future__ import annotations

import ast
import importlib
import inspect
import pkgutil
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_type_hints

import pytest
import typer

from tests.cli.conftest import Trocar
from trocar.services.cli.app import add_installed_verbs, app
from trocar.services.messages.exit_codes import ExitCode
from trocar.services.runtime.errors import UserError

ROOT = Path(__file__).parents[2]
FOLDERS = ("services", "review", "studies", "trocar/envs", "protocol")
#: Calls that end a process with the number that they are given.
_ENDS = {"sys.exit", "typer.Exit", "SystemExit", "os._exit", "exit"}
#: Checked by the process that asks for them, which ends with a code of its own.
_BETWEEN_PROCESSES = {"services/gateway/hdapi/host_checks.py", "services/supervisor/crew/fork_server.py"}


def _numbers(tree: ast.AST) -> Iterator[int]:
    """Yield the lines of a source on which a process' exit code is a bare number."""
    for node in ast.walk(tree):
        value: ast.expr | None = None
        if isinstance(node, ast.Call) and ast.unparse(node.func) in _ENDS and node.args:
            value = node.args[0]
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            value = node.value if any(ast.unparse(each).endswith("exit_code") for each in targets) else None
        if isinstance(value, ast.Constant) and isinstance(value.value, int):
            yield node.lineno


def test_no_exit_code_is_a_bare_number() -> None:
    found = []
    for path in (path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py"))):
        name = str(path.relative_to(ROOT))
        if "node_modules" not in name and name not in _BETWEEN_PROCESSES:
            found += [f"{name}:{line}" for line in _numbers(ast.parse(path.read_text(encoding="utf-8")))]
    assert not found, f"name them in services/messages/exit_codes.py: {found}"


def test_a_bare_number_would_be_found() -> None:
    text = "import sys\nsys.exit(3)\nclass A:\n    exit_code = 4\nraise typer.Exit(1)\nsys.exit(main())"
    assert list(_numbers(ast.parse(text))) == [5, 2, 4] or sorted(_numbers(ast.parse(text))) == [2, 4, 5]


def test_every_error_of_a_person_ends_with_a_code_of_the_table() -> None:
    for package in ("trocar.services", "trocar.review", "trocar.studies", "trocar.envs"):
        module = importlib.import_module(package)
        for each in pkgutil.walk_packages(module.__path__, f"{package}."):
            if each.name.rpartition(".")[2] in ("errors", "session", "validation", "attempts"):
                importlib.import_module(each.name)
    kinds, todo = set[type[UserError]](), [UserError]
    while todo:
        kinds.add(kind := todo.pop())
        todo += kind.__subclasses__()
    assert len(kinds) >= 12
    for kind in kinds:
        assert isinstance(kind.exit_code, ExitCode), kind


def _verbs(command: Any, words: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    for word, inner in getattr(command, "commands", {}).items():
        if inner.hidden:  # a former name, which says the present one first
            continue
        yield from _verbs(inner, (*words, word)) if hasattr(inner, "commands") else [((*words, word), inner)]


#: What names a file by its path or by its name in a folder, and is no path to the parser.
_NAMES = {"rig", "rig_name", "scene", "scenario", "rules", "what", "device"}
#: Parameters of such names that name no file: an order, and what attempts are chosen by.
_NO_FILES = {("attempt", "what"), ("attempts list", "scenario"), ("attempts curve", "scenario")}
#: Words that a verb needs beside the one that is tried.
_BESIDE = {
    "export": ("--to", "csv"),
    "tune": ("--out", "tuned.yaml"),
    "study": ("modes", "--smallest"),
    "haptics": ("--hands", "1"),
    "stability": ("--minutes", "0"),
    "attempts curve": ("heron-17", "insertion"),
    "attempts export": ("heron-17",),
    "attempts erase": ("heron-17",),
    "attempt": ("new",),
}
_SAMPLE = ROOT / "docs" / "examples" / "recordings"


def _cases() -> Iterator[tuple[str, str, tuple[str, ...]]]:
    """Yield verb, parameter and words of a command whose one file is not there and cannot be made."""
    add_installed_verbs()
    for words, verb in _verbs(typer.main.get_command(app)):
        name, hints = " ".join(words), get_type_hints(inspect.unwrap(verb.callback))
        for parameter in verb.params:
            is_path = "Path" in str(hints[parameter.name]) if parameter.name in hints else False
            if not (is_path or parameter.name in _NAMES) or (name, parameter.name) in _NO_FILES:
                continue
            nowhere = "/proc/nowhere/file.yaml"
            given = (nowhere,) if parameter.param_type_name == "argument" else (parameter.opts[0], nowhere)
            yield name, parameter.name, (*words, *given)


CASES = [*_cases()]


def _needed(name: str, parameter: str) -> tuple[str, ...]:
    """Return the other words that a verb needs."""
    sample = str(next(_SAMPLE.glob("*.mcap")))
    beside = _BESIDE.get(name, ())
    if name == "replay" and parameter != "file":
        return (sample, "--pictures")
    if name in ("export", "score", "report") and parameter not in ("file", "files", "what"):
        return (*beside, sample)
    if name == "anatomy" and parameter != "file":
        return (__file__,)
    if name == "fem" and parameter != "file":
        return (str(ROOT / "configs" / "fem" / "incised-duct.yaml"),)
    if name == "tune" and parameter != "scene":
        return ("--scene", "insertion")
    if name == "tune":
        return ("--out", "tuned.yaml")
    return beside


def test_the_walk_sees_the_verbs_that_take_files() -> None:
    seen = {name for name, _, _ in CASES}
    expected = {"up", "replay", "repair", "score", "report", "diagnose latency", "fem", "export", "classroom", "tune"}
    assert expected <= seen
    assert len(CASES) > 40


@pytest.mark.parametrize(("name", "parameter", "words"), CASES, ids=[f"{name} {what}" for name, what, _ in CASES])
def test_a_file_that_is_not_there_ends_every_verb_alike(
    trocar: Trocar,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    name: str,
    parameter: str,
    words: tuple[str, ...],
) -> None:
    """A missing recording was 5, a missing file of flights 1, and any other 2."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    ran = trocar(*words, *_needed(name, parameter))
    assert ran.code == ExitCode.USAGE, ran.err
    assert re.search(r"/proc/nowhere|nowhere", ran.sentence())


def test_version(trocar: Trocar) -> None:
    ran = trocar("--version")
    assert (ran.code, ran.err) == (0, "")
    assert re.fullmatch(r"trocar \d+\.\d+\.\d+\S*\n", ran.out)
