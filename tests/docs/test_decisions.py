"""docs/decisions: each fits a screen and is in the index; links lead somewhere, and files that pages name exist."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DECISIONS = sorted(path for path in (ROOT / "docs" / "decisions").glob("*.md") if path.name != "README.md")
EXPLANATIONS = [ROOT / "docs" / "explanation" / name for name in ("design.md", "fem.md", "reduced-duct.md")]
INDEX = ROOT / "docs" / "decisions" / "README.md"
LINK = re.compile(r"\]\(([^)#:]+)(?:#[^)]*)?\)")
#: A file in the repository, as pages name it.
FILE = re.compile(r"`((?:benchmarks|configs|deploy|docs|protocol|services|studies|review|tests)/[\w./-]+)`")


def _name(path: Path) -> str:
    return path.name


def test_the_index_lists_every_decision_once() -> None:
    """None is missing, none is listed twice, none is gone."""
    listed = [link for link in LINK.findall(INDEX.read_text(encoding="utf-8")) if "/" not in link]
    assert sorted(listed) == [page.name for page in DECISIONS]


@pytest.mark.parametrize("page", [INDEX, *DECISIONS, *EXPLANATIONS], ids=_name)
def test_what_a_page_names_exists(page: Path) -> None:
    """Its relative links lead to files, and so do paths in backticks."""
    text = page.read_text(encoding="utf-8")
    gone = [link for link in LINK.findall(text) if not (page.parent / link).exists()]
    gone += [path for path in FILE.findall(text) if not (ROOT / path).exists()]
    assert not gone
