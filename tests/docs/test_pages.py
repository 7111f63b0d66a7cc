"""The pages as a whole: links, words, the index, what the code makes, and names of files in the text."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.docs.reference import FOLDER, PAGES, ROOT

DOCS = ROOT / "docs"
FILES = [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]
_LINK = re.compile(r"\]\(([^)\s]+)\)")
_NAMED = re.compile(r"`((?:services|studies|review|protocol|benchmarks|configs|deploy|tests)/[\w./-]+)`")
_IN_RECIPES = re.compile(r"```.*?```", re.DOTALL)


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.+)$", _IN_RECIPES.sub("", page.read_text(encoding="utf-8")), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", FILES, ids=[str(page.relative_to(ROOT)) for page in FILES])
def test_every_link_leads_somewhere(page: Path) -> None:
    for link in _LINK.findall(_IN_RECIPES.sub("", page.read_text(encoding="utf-8"))):
        target, _, anchor = link.partition("#")
        if "://" in target:
            continue
        file = (page.parent / target).resolve() if target else page
        assert file.exists(), f"{link} leads nowhere"
        assert not anchor or anchor in anchors(file), f"{link}: there is no such heading"


@pytest.mark.parametrize("page", FILES, ids=[str(page.relative_to(ROOT)) for page in FILES])
def test_every_file_that_a_page_names_is_there(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    made = {*re.findall(r"^ *# (\S+/\S+)$", text, re.MULTILINE), *re.findall(r"Write `(\S+)`", text)}  # by a reader
    for name in _NAMED.findall(_IN_RECIPES.sub("", text)):
        assert name in made or (ROOT / name).exists() or any(ROOT.glob(f"{name}.*")), f"there is no {name}"


def test_every_page_is_in_the_index() -> None:
    listed = {(DOCS / link).resolve() for link in _LINK.findall((DOCS / "README.md").read_text(encoding="utf-8"))}
    decisions = DOCS / "decisions"
    pages = {page for page in FILES[1:] if page != DOCS / "README.md" and page.parent != decisions}
    assert not {str(page.relative_to(DOCS)) for page in pages - listed}


@pytest.mark.parametrize("name", PAGES)
def test_a_page_that_the_code_makes_is_what_it_makes_now(name: str) -> None:
    assert (FOLDER / name).read_text(encoding="utf-8") == PAGES[name](), "run `python -m tests.docs.reference`"
