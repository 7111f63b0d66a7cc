"""What doctor and gateway say on the page's Devices: every sentence of their sources has a German one."""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

from tests.review.sentences import numbered, texts_of
from trocar import services

_SERVICES = Path(services.__file__).parent
_GERMAN = json.loads(
    (_SERVICES / "visualization" / "web" / "src" / "settings" / "rig.de.json").read_text(encoding="utf-8")
)
_DOCTOR = ("host_checks", "probes", "delay_checks", "doctor", "preemption")
#: Calls whose arguments a check shows.
_CHECKS = {"HostCheck", "finding", "CheckResult", "probe"}
#: Methods whose argument a person reads as an event.
_SAYING = {"say", "_say", "fail"}
#: What a shell or Python is to run.
_COMMAND = re.compile(r"\s*(?:sudo [^(,]*$|pip |apt |import |type can|npm )")


def _told(path: Path, calls: set[str], *, kept: bool) -> Iterator[str]:
    """Yield the texts of calls in a file; where `kept`, also those of values that are returned or given a name."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            for each in node.args if name in calls else ():
                yield from texts_of(each)
        elif kept and isinstance(node, ast.Assign | ast.AnnAssign | ast.Return) and node.value is not None:
            yield from (text for text in texts_of(node.value) if text.count(" ") > 1)


def _keys(texts: Iterable[str]) -> set[str]:
    """Return texts as keys of the catalogue, without commands and what has no words."""
    words = {text for text in texts if re.search(r"[a-z]{2}", text) and not _COMMAND.match(text)}
    words = {re.sub(r"^supervisor: \{\}(?: ?\{\})+$", "supervisor: {}", text) for text in words}  # a sentence in parts
    return {numbered(text) for text in words}


def _of_checks() -> set[str]:
    files = [*((_SERVICES / "cli" / f"{name}.py") for name in _DOCTOR), *_SERVICES.glob("gateway/**/*checks.py")]
    return _keys(text for path in files for text in _told(path, _CHECKS, kept=True))


def _of_gateway() -> set[str]:
    files = [path for path in _SERVICES.glob("gateway/**/*.py") if "checks" not in path.name]
    return _keys(text for path in files for text in _told(path, _SAYING, kept=True))


def _of_supervisor() -> set[str]:
    files = _SERVICES.glob("supervisor/**/*.py")
    return _keys(text for path in files for text in _told(path, _SAYING, kept=False) if " " in text)


@pytest.mark.parametrize("told", [_of_checks, _of_gateway, _of_supervisor])
def test_every_sentence_on_devices_has_a_german_one(told) -> None:
    found = told()
    assert len(found) > 10
    assert sorted(found - _GERMAN.keys()) == []


def test_translations_have_the_same_values() -> None:
    for english, german in _GERMAN.items():
        assert sorted(re.findall(r"\{(\d+)\}", english)) == sorted(re.findall(r"\{(\d+)\}", german)), english


def test_no_translation_is_of_a_sentence_that_is_gone() -> None:
    parts = ("cli", "gateway", "supervisor", "messages")
    source = " ".join(path.read_text(encoding="utf-8") for part in parts for path in _SERVICES.glob(f"{part}/**/*.py"))
    words = set(re.findall(r"[a-zA-Z']+", source))
    for english in _GERMAN:
        assert set(re.findall(r"[a-zA-Z']+", english)) <= words, english
