"""What pages that stand alone, such as a report, have of the rig's page: colours, type, controls, and words."""

from __future__ import annotations

import json
from pathlib import Path

#: What stands in a page for the style, for the script of `said.mjs`, and for the words of a language.
_STYLE, _SAID, _WORDS = "/*STYLE*/", "/*SAID*/", "/*WORDS*/"
_FOLDER = Path(__file__).parent


def page_style() -> str:
    """Return the style sheet, dark and light as the reader's system has it."""
    return (_FOLDER / "page_style.css").read_text(encoding="utf-8")


def styled(page: str) -> str:
    """Return a page's text with the style at its place."""
    return page.replace(_STYLE, page_style(), 1)


def speaking(page: str, own_words: Path) -> str:
    """Return a page's text with its own words in German, those of rig and school, and the script that finds them."""
    answers = json.loads((_FOLDER / "answers.de.json").read_text(encoding="utf-8"))
    words = answers | json.loads(own_words.read_text(encoding="utf-8"))
    script = (_FOLDER / "said.mjs").read_text(encoding="utf-8").replace("export class", "class")
    told = json.dumps(words, ensure_ascii=False).replace("</", "<\\/")
    return page.replace(_SAID, script, 1).replace(_WORDS, told, 1)
