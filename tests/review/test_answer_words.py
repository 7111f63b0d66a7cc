"""What rig, school and class server say to trainees and instructors has a German sentence, wherever it is made."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.review.sentences import numbered, raised, sentences, told_to
from trocar import review, services
from trocar.review.attempts.advice import METRICS
from trocar.review.school.courses import course_names, load_course
from trocar.services.start.first_start import NOTICE
from trocar.services.training.errors import ERRORS
from trocar.services.training.scenario import load_scenario, scenario_names
from trocar.services.training.situation import TISSUES

_SERVICES, _REVIEW = Path(services.__file__).parent, Path(review.__file__).parent
_GERMAN = json.loads((_SERVICES / "messages" / "answers.de.json").read_text(encoding="utf-8"))
#: What is no sentence to a person: policies of a page, a database's language, a command, an address in another's words.
_NO_WORDS = re.compile(r"[a-z]+-src |PRAGMA |SELECT |<|trocar [a-z]|--|#: |kernel progress$")


def _all_of(*paths: str, left_out: tuple[str, ...] = ()) -> set[str]:
    """Return every sentence of these files of services or review."""
    files = [each for path in paths for root in (_SERVICES, _REVIEW) for each in root.glob(path)]
    assert len(files) >= len(paths)
    found = {each for path in files if path.stem not in left_out for each in sentences(path)}
    return {each for each in found if not _NO_WORDS.match(each)}


def _of_school() -> set[str]:
    found = _all_of("school/*.py", left_out=("__main__", "reports"))
    return found | {each for path in _REVIEW.glob("attempts/store/*.py") for each in raised(path)}


def _of_settings() -> set[str]:
    return _all_of("settings/*.py", left_out=("page",))


def _of_class() -> set[str]:
    return _all_of("classroom/*.py", left_out=("__init__",))


def _of_page() -> set[str]:
    told = _all_of("supervisor/page/web.py", "supervisor/page/school.py", "supervisor/page/command_socket.py")
    return told | _all_of("supervisor/control/commands.py", "visualization/page_hands.py")


def _of_judge() -> set[str]:
    """Return why a rig is degraded or stopped, which stands beside its state."""
    told = _all_of("supervisor/judge/contracts.py", "supervisor/crew/hang_detection.py", "supervisor/crew/silence.py")
    return told | sentences(_SERVICES / "supervisor" / "control" / "supervisor.py", within=("safe_stop",))


def _of_start() -> set[str]:
    """Return what the page says in the place of the picture while the rig starts."""
    found = {each for path in _SERVICES.glob("**/*.py") for each in told_to(path, {"progress", "_progress"})}
    return found | _all_of("start/kernel_progress.py") | {NOTICE}


def _of_training() -> set[str]:
    names = ("attempt", "fitness", "hints", "rig_observer", "trainer", "__main__")
    return _all_of(*(f"training/{name}.py" for name in names))


def _of_reports() -> set[str]:
    found = _all_of("attempts/advice.py", "export/still.py")
    found |= sentences(_REVIEW / "attempts" / "report.py", within=("verdict",))
    owners = {"left", "right", "tip", *(tissue.replace("_", " on ") for tissue in TISSUES)}
    return found | {what for _, what in ERRORS.values()} | {numbered(each) for each in METRICS.values()} | owners


def _of_shipped_files() -> set[str]:
    """Return titles and hints of the courses and scenarios, and the names of what they lead to."""
    courses = [load_course(name) for name in course_names()]
    told = {
        words for course in courses for words in (course.title, course.about, *(step.title for step in course.steps))
    }
    for scenario in (load_scenario(name) for name in scenario_names()):
        told |= {scenario.title, scenario.hint, scenario.goal.branch.replace("_", " ")}
    return told - {""}


_SOURCES: list[Callable[[], set[str]]] = [
    _of_school, _of_settings, _of_class, _of_page, _of_judge, _of_start, _of_training, _of_reports, _of_shipped_files,
]  # fmt: skip


@pytest.mark.parametrize("told", _SOURCES)
def test_every_sentence_has_a_german_one(told: Callable[[], set[str]]) -> None:
    found = told()
    assert len(found) > 5
    assert sorted(found - _GERMAN.keys()) == []


def test_a_sentence_without_a_german_one_is_found(tmp_path: Path) -> None:
    """Whatever way it is made: raised, returned, one of two, with values in it, or the default of a field."""
    source = '''
class Answer:
    """A docstring is not read."""
    text: str = "nothing has come"
def f(x):
    log.warning("a log is not read")
    if x:
        raise UserError(f"there is no {x!r} here")
    return {"error": "the one way" if x else "the other way"}
'''
    path = tmp_path / "source.py"
    path.write_text(source)
    assert sentences(path) == {"nothing has come", "there is no {0} here", "the one way", "the other way"}


def _values(text: str) -> Iterator[str]:
    return iter(sorted(re.findall(r"\{(\d+)\}", text)))


def test_translations_have_the_same_values() -> None:
    for english, german in _GERMAN.items():
        assert list(_values(english)) == list(_values(german)), english


def test_no_translation_is_of_a_sentence_that_is_gone() -> None:
    known = {each for told in _SOURCES for each in told()}
    assert sorted(english for english in _GERMAN if english not in known and " " in english) == []
