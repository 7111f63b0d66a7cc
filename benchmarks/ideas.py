"""The ideas of the house, counted: what each module is for, constants by whether a reason stands beside them, homonyms.

The page `docs/reference/ideas.md` is written from this (``python -m tests.docs.reference``), so that a change that adds a
mechanism, a constant or a second meaning of a name shows it.
"""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("services", "protocol")
#: Words by which a comment gives a reason, not only a name: a proxy, which a person may judge otherwise.
_REASON = re.compile(
    r"\b(because|since|so that|as|otherwise|else|or|for|than|without|until|measured|took|takes|seen|needs?|twice|half|times"
    r"|least|most|longest|shortest|beyond|below|above|by|RFC|ISO|IEC|datasheet|Linux|kernel|firmware|et al)\b"
)
_NUMBER = re.compile(r"\d")


@dataclass(slots=True)
class Package:
    """What was found in the modules of one folder."""

    modules: dict[str, str] = field(default_factory=dict)
    reasoned: list[str] = field(default_factory=list)
    bare: list[str] = field(default_factory=list)


def packages() -> dict[str, Package]:
    """Return the packages by their folder, with modules and numeric constants."""
    found: dict[str, Package] = defaultdict(Package)
    for path in _sources():
        text = path.read_text(encoding="utf-8")
        tree = ast.parse(text)
        package = found[path.parent.relative_to(ROOT).as_posix()]
        if path.name != "__init__.py" or len(tree.body) > 1:
            package.modules[path.stem] = _first_sentence(ast.get_docstring(tree) or "")
        comments = _comments(text)
        for names, node, after in _constants(tree):
            words = " ".join([*_beside(node, comments), after])
            (package.reasoned if _REASON.search(words) else package.bare).extend(
                f"{path.stem}.{name}" for name in names
            )
    return dict(sorted(found.items()))


def homonyms() -> dict[str, list[str]]:
    """Return the public class names that stand in more than one module, with these modules."""
    places: dict[str, list[str]] = defaultdict(list)
    for path in _sources():
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].append(path.relative_to(ROOT).with_suffix("").as_posix())
    return {name: where for name, where in sorted(places.items()) if len(where) > 1}


def page() -> str:
    """Return the page."""
    found = packages()
    reasoned, bare = (sum(len(getattr(each, name)) for each in found.values()) for name in ("reasoned", "bare"))
    lines = [
        "# Ideas by package",
        "",
        "Written by `python -m tests.docs.reference`. A module is one mechanism; its line says what it is for. A numeric",
        "constant counts as one with a reason if the comment beside it says why, as far as a program can tell. A name that",
        "stands for several things is listed at the end.",
        "",
        f"Modules: {sum(len(each.modules) for each in found.values())}. Constants: {reasoned} with a reason, {bare} without.",
        "",
    ]
    for folder, package in found.items():
        lines += [
            f"## {folder}",
            "",
            f"Constants: {len(package.reasoned)} with a reason, {len(package.bare)} without.",
            "",
        ]
        lines += [f"- `{module}`: {what}" for module, what in sorted(package.modules.items())]
        if package.bare:
            lines += ["", f"Without a reason: {', '.join(f'`{name}`' for name in package.bare)}."]
        lines.append("")
    lines += ["## Names that stand for several things", ""]
    lines += [f"- `{name}`: {', '.join(f'`{place}`' for place in places)}" for name, places in homonyms().items()]
    return "\n".join(lines) + "\n"


def _sources() -> Iterator[Path]:
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*.py")):
            if "node_modules" not in path.parts:
                yield path


def _first_sentence(text: str) -> str:
    return " ".join(text.split("\n\n")[0].split())


def _constants(tree: ast.Module) -> Iterator[tuple[list[str], ast.stmt, str]]:
    """Yield the names of each assignment of numbers to names in capitals, its node, and the text that follows it."""
    for node, following in zip(tree.body, [*tree.body[1:], None], strict=True):
        targets = (
            node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
        )
        names = [each.id for target in targets for each in ast.walk(target) if isinstance(each, ast.Name)]
        names = [name for name in names if name.isupper()]
        value = getattr(node, "value", None)
        if names and value is not None and _NUMBER.search(ast.unparse(value)) and not _is_enumeration(value):
            is_text = isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant)
            yield names, node, str(following.value.value) if is_text else ""  # type: ignore[union-attr]


def _is_enumeration(value: ast.expr) -> bool:
    """Return whether the numbers are only places in an array: ``A, B, C = range(3)``, or a text with digits."""
    return (isinstance(value, ast.Call) and ast.unparse(value.func) in ("range", "re.compile")) or (
        isinstance(value, ast.Constant) and isinstance(value.value, str)
    )


def _comments(text: str) -> dict[int, str]:
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    return {each.start[0]: each.string for each in tokens if each.type == tokenize.COMMENT}


def _beside(node: ast.stmt, comments: dict[int, str]) -> Iterator[str]:
    """Yield the comments in the lines of a statement and directly above it."""
    for line in range(node.lineno, (node.end_lineno or node.lineno) + 1):
        yield comments.get(line, "")
    line = node.lineno - 1
    while line in comments:
        yield comments[line]
        line -= 1
