"""The follower of recipes does what a block says, and stops where a recipe has gone stale."""

from __future__ import annotations

import os
import py_compile
import shutil
import socket
import subprocess
import sys
from importlib.util import cache_from_source
from pathlib import Path

import pytest

from tests.recipes.tree_copy import RECIPES, ROOT, TreeCopy, take_bytecode

pytestmark = pytest.mark.timeout(600)  # a changed copy of the tree compiles anew

RECIPE = """
# Recipes

## Adding a word
1. A new file:

   ```python
   # services/scenes/word.py
   \"""A word.\"""

   WORD = "trocar"
   ```

2. Where it is known:

   ```diff
   --- services/scenes/__init__.py
   {anchor}
   +from trocar.services.scenes.word import WORD as WORD
   ```

   and what it looks like then, for the reader:

   ```python
   WORD
   ```

3. Look at it:

   ```sh
   python -c "from trocar.services.scenes import WORD; print(WORD)" > word.txt
   ```

## Something else

```sh
exit 3
```
"""


@pytest.fixture
def anchor() -> str:
    """The last import of a file that nobody edits for this test's sake."""
    lines = (ROOT / "services" / "scenes" / "__init__.py").read_text().splitlines()
    return [f" {line}" for line in lines if line.startswith("from ")][-1]


def _told(tree: TreeCopy, anchor: str) -> None:
    (tree.root / RECIPES).write_text(RECIPE.format(anchor=anchor))


def test_blocks_are_done_from_top_to_bottom(tree: TreeCopy, anchor: str) -> None:
    _told(tree, anchor)
    tree.follow("Adding a word")
    assert (tree.root / "word.txt").read_text() == "trocar\n"
    assert not (ROOT / "services" / "scenes" / "word.py").exists()
    assert str(tree.root) in tree.python("from trocar import protocol; print(protocol.__file__)")


@pytest.mark.parametrize("stale", [" from nowhere import nothing", ""])
def test_a_place_that_is_not_there_once_is_no_place(tree: TreeCopy, stale: str) -> None:
    _told(tree, stale)
    with pytest.raises(AssertionError, match=r"has these lines \d+ times"):
        tree.follow("Adding a word")


def test_what_lint_refuses_fails_the_recipe(tree: TreeCopy, anchor: str) -> None:
    _told(tree, anchor)
    recipe = tree.root / RECIPES
    recipe.write_text(recipe.read_text().replace('WORD = "trocar"', 'import os\n\n   WORD = "trocar"'))
    with pytest.raises(AssertionError, match="F401"):
        tree.follow("Adding a word")


def test_a_command_that_fails_fails_the_recipe(tree: TreeCopy, anchor: str) -> None:
    _told(tree, anchor)
    with pytest.raises(AssertionError, match="ended with 3"):
        tree.follow("Something else")


def test_a_section_that_is_not_there_is_named(tree: TreeCopy, tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="no section 'Adding a unicorn'"):
        tree.follow("Adding a unicorn")


def test_a_restored_copy_is_as_new(tree: TreeCopy, anchor: str) -> None:
    """Files made, changed and removed, folders and sockets among them."""

    def content() -> dict[str, bytes]:
        files = (path for path in tree.root.rglob("*") if path.is_file() and "__pycache__" not in path.parts)
        return {str(path.relative_to(tree.root)): path.read_bytes() for path in files}

    as_new = content()
    _told(tree, anchor)
    tree.follow("Adding a word")
    (tree.root / "protocol" / "topics.py").unlink()
    (tree.root / "bus" / "deep").mkdir(parents=True)
    (tree.root / "bus" / "deep" / "file").touch()
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(os.path.relpath(tree.root / "bus" / "socket"))
    assert content() != as_new
    tree.restore()
    assert content() == as_new
    assert not (tree.root / "bus").exists()


@pytest.mark.parametrize("beside", [True, False])
def test_what_the_tree_has_compiled_is_not_compiled_again_in_a_copy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, beside: bool
) -> None:
    monkeypatch.setattr(sys, "pycache_prefix", None if beside else str(tmp_path / "kept"))
    tree, copy = tmp_path / "tree", tmp_path / "copy"
    (tree / "parts").mkdir(parents=True)
    for name in ("same", "changed"):
        (tree / "parts" / f"{name}.py").write_text(f"X = {name!r}\n")
        py_compile.compile(str(tree / "parts" / f"{name}.py"))
    shutil.copytree(tree, copy, ignore=shutil.ignore_patterns("__pycache__"))
    take_bytecode(tree, copy, "parts")
    (copy / "parts" / "changed.py").write_text("X = 'another one'\n")
    monkeypatch.setattr(sys, "pycache_prefix", None)
    of_copy = [Path(cache_from_source(str(copy / "parts" / f"{name}.py"))) for name in ("same", "changed")]
    before = [path.stat().st_ino for path in of_copy]
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": ""}
    code = "from parts import changed, same; print(same.X, changed.X)"
    done = subprocess.run([sys.executable, "-c", code], cwd=copy, env=environment, capture_output=True, text=True)
    assert done.stdout == "same another one\n"
    assert [path.stat().st_ino == inode for path, inode in zip(of_copy, before, strict=True)] == [True, False]
