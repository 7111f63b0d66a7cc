"""The class page in German: every sentence that it can show has its translation, with the same values in it."""

import json
import re
from pathlib import Path

import pytest

from trocar.review import classroom
from trocar.review.classroom.desk import What
from trocar.review.school.reports import SCALES
from trocar.services.messages.page_style import speaking
from trocar.services.supervisor.judge.state_machine import RigState

_FOLDER = Path(classroom.__file__).parent
_PAGE = (_FOLDER / "page.html").read_text(encoding="utf-8")
_GERMAN = json.loads((_FOLDER / "words.de.json").read_text(encoding="utf-8"))
_MARKUP, _, _REST = _PAGE.partition("<script type")
_SCRIPT = _REST.partition("<script>")[2]
_SAME = {"English", "Deutsch", "…"}


def _in_markup() -> set[str]:
    body = _MARKUP[_MARKUP.index("<header>") :]
    texts = {text.strip() for text in re.findall(r">([^<>]+)<", body)} - {""}
    return texts | set(re.findall(r'(?:aria-label|placeholder)="([^"]+)"', body))


def _in_script() -> set[str]:
    """Sentences of calls t("…"), of both branches of t(a ? "…" : "…"), and of the tables of phases, errors and acts."""
    said = set(re.findall(r'\bt\("([^"]+)"', _SCRIPT))
    for one, other in re.findall(r'\bt\([\w.= ]+ \? "([^"]+)" : "([^"]+)"', _SCRIPT):
        said |= {one, other}
    for table in re.findall(r"(?:PHASES|ERRORS) = \{(.*?)\};", _SCRIPT, re.DOTALL):
        said |= set(re.findall(r'"([^"]+)"', table))
    return said | set(re.findall(r'\["(\w+)", \(\) =>', _SCRIPT))


def _from_elsewhere() -> set[str]:
    states = {state.value.replace("_", " ") for state in RigState} | {"silent"}
    acts = {word.replace("_", " ") for word in What.__args__}
    return states | acts | {item for items, _ in SCALES.values() for item in items}


@pytest.mark.parametrize("said", [_in_markup, _in_script, _from_elsewhere])
def test_every_sentence_is_translated(said):
    found = said()
    assert len(found) > 15
    assert sorted(found - _GERMAN.keys() - _SAME) == []


def test_no_translation_is_of_a_sentence_that_is_gone():
    everything = _PAGE + " ".join(_from_elsewhere()) + " armed done abandoned success failure incomplete unknown none "
    everything += " rate bookmark expert pin erase settings restart felt test finished instructor"
    assert [sentence for sentence in _GERMAN if sentence not in everything] == []


def test_translations_name_the_same_values():
    for english, german in _GERMAN.items():
        assert sorted(re.findall(r"\{(\w+)\}", english)) == sorted(re.findall(r"\{(\w+)\}", german)), english


#: What a bench, the school or this server says, as the script reads it.
_FROM_SERVERS = (
    "told.error", "told.remark", "now.title", "now.practice_only", "rig.fault", "rig.reason", "each.title",
    "attempt.title", "row.course", "row.next", "error.message", "(await answer.json()).error", ", text }",
)  # fmt: skip


@pytest.mark.parametrize("read", _FROM_SERVERS)
def test_what_servers_say_passes_through_a_translation(read):
    shown = [line for line in _SCRIPT.splitlines() if read in line]
    assert shown
    for line in shown:
        assert re.search(r"\b(?:said|t)\(|\.map\(said\)", line), line


def test_the_page_holds_the_script_and_the_words_of_its_translation():
    html = speaking(_PAGE, _FOLDER / "words.de.json")
    assert "class Catalogue" in html
    assert "export " not in html.partition("<script>")[2]
    words = json.loads(re.search(r'id="words">(.*?)</script>', html, re.DOTALL)[1])
    assert words["the rig was late"] == "der Simulator war zu spät"
    assert words["Class"] == "Klasse"
