"""The recipe "Adding a study", followed to the letter: its file is found and its points are on the page."""

from __future__ import annotations

import csv

import pytest

from tests.recipes.tree_copy import TreeCopy

pytestmark = pytest.mark.timeout(600)  # a changed copy of the tree compiles anew


def test_a_study_of_ones_own_is_one_file(tree: TreeCopy) -> None:
    tree.follow("Adding a study")
    with (tree.root / "study" / "table.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {row["setting"] for row in rows} == {"ratio 0.05", "ratio 0.2"}
    assert "Damping of the duct" in (tree.root / "study" / "index.html").read_text(encoding="utf-8")
