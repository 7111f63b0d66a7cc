"""What the recipes' files import is made where they import it from: else `./dev test` refuses what they led to."""

from __future__ import annotations

import ast
import re

import pytest

from tests.recipes.tree_copy import RECIPES, ROOT

pytestmark = pytest.mark.timeout(600)  # a changed copy of the tree compiles anew

FILES = re.findall(r"```python\n *# (\S+\.py)\n(.*?)```", (ROOT / RECIPES).read_text(encoding="utf-8"), re.S)


def exported(module: str) -> set[str]:
    """Names that a module of the tree makes itself, or lists in `__all__`; its own modules, if it is a package."""
    path = ROOT / module.replace(".", "/")
    file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    names = {each.stem for each in path.glob("*.py")} if path.is_dir() else set()
    for node in ast.parse(file.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        for target in targets:
            names |= {each.id for each in ast.walk(target) if isinstance(each, ast.Name)} if target else set()
            if isinstance(target, ast.Name) and target.id == "__all__":
                names |= set(ast.literal_eval(node.value))  # type: ignore[attr-defined]
    return names


@pytest.mark.parametrize(("path", "text"), FILES, ids=[path for path, _ in FILES])
def test_a_file_of_a_recipe_imports_what_is_made_there(path: str, text: str) -> None:
    indent = min(len(line) - len(line.lstrip()) for line in text.splitlines() if line.strip())
    tree = ast.parse("\n".join(line[indent:] for line in text.splitlines()))
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(("trocar.services", "trocar.protocol")):
            missing = {name.name for name in node.names} - exported(node.module or "")
            assert not missing, f"{path}: {node.module} does not make {missing}"


def test_there_are_files_to_look_at() -> None:
    assert len(FILES) >= 8
