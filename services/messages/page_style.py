"""One look for the pages that stand alone, such as a report: colours, type and controls of the rig's own page."""

from __future__ import annotations

from pathlib import Path

#: What stands in a page for the style.
_PLACE = "/*STYLE*/"


def page_style() -> str:
    """Return the style sheet, dark and light as the reader's system has it."""
    return Path(__file__).with_name("page_style.css").read_text(encoding="utf-8")


def styled(page: str) -> str:
    """Return a page's text with the style at its place."""
    return page.replace(_PLACE, page_style(), 1)
