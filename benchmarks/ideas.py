"""The ideas of the house, counted: what each module is for, constants by whether a reason stands beside them, homonyms.

The page `docs/reference/ideas.md` is written from this (``python -m tests.docs.reference``), so that a change that
adds a mechanism, a constant or a second meaning of a name shows it.
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
FOLDERS = ("services", "protocol", "review")
#: Words by which a comment gives a reason, not only a name: a proxy, which a person may judge otherwise.
_REASON = re.compile(
    r"\b(because|since|so that|as|otherwise|else|or|for|than|without|until|measured|took|takes|seen|needs?|twice|half"
    r"|times|least|most|longest|shortest|beyond|below|above|by|RFC|ISO|IEC|datasheet|Linux|kernel|firmware|et al)\b"
)
#: What CONTRIBUTING asks for where there is no reason: such a number is counted apart.
_ASSUMED = re.compile(r"\bassumptions?\b", re.IGNORECASE)


@dataclass(slots=True)
class Package:
    """What was found in the modules of one folder."""

    modules: dict[str, str] = field(default_factory=dict)
    reasoned: list[str] = field(default_factory=list)
    assumed: list[str] = field(default_factory=list)
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
            words = " ".join([*_beside(node, comments, text.splitlines()), after])
            said = package.reasoned if _REASON.search(words) else package.bare
            kept = package.assumed if _ASSUMED.search(words) else said
            kept += [f"{path.stem}.{name}" for name in names]
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
    reasoned, assumed, bare = (
        sum(len(getattr(each, kind)) for each in found.values()) for kind in ("reasoned", "assumed", "bare")
    )
    lines = [
        "# Ideas by package",
        "",
        "Made by `python -m tests.docs.reference`; do not edit by hand.",
        "",
        "A module is one mechanism; its line says what it is for. A numeric constant counts as one with a reason if",
        "the comment beside it says why, as far as a program can tell. A comment that ends in a colon is for all lines",
        "down to the next empty one. Codes and places that are counted from 0 are no numbers that somebody chose.",
        "Names that stand for several things are listed at the end.",
        "",
        f"Modules: {sum(len(each.modules) for each in found.values())}.",
        f"Constants: {reasoned} with a reason, {assumed} assumed, {bare} without.",
        "",
    ]
    for folder, package in found.items():
        counts = f"{len(package.reasoned)} with a reason, {len(package.assumed)} assumed, {len(package.bare)} without"
        lines += [f"## {folder}", "", f"Constants: {counts}.", ""]
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
        if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
            continue
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        names = [each.id for target in targets for each in ast.walk(target) if isinstance(each, ast.Name)]
        names = [name for name in names if name.isupper()]
        if names and _is_tuned(names, node.value):
            is_text = isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant)
            yield names, node, str(following.value.value) if is_text else ""  # type: ignore[union-attr]


def _is_tuned(names: list[str], value: ast.expr) -> bool:
    """Return whether somebody chose the numbers, which are no places in an array and no codes of a format."""
    numbers = [each.value for each in ast.walk(value) if isinstance(each, ast.Constant)]
    if any(isinstance(each, bool) or not isinstance(each, int | float) for each in numbers):
        return False
    is_place = len(names) > 1 and numbers[:1] == [0] and numbers == sorted(set(numbers))
    is_nothing = len(numbers) > 1 and not any(numbers)
    return bool(numbers) and all(map(_is_arithmetic, ast.walk(value))) and not is_place and not is_nothing


def _is_arithmetic(node: ast.AST) -> bool:
    kinds = (ast.Constant, ast.UnaryOp, ast.BinOp, ast.Tuple, ast.Name, ast.Attribute)
    return isinstance(node, (*kinds, ast.operator, ast.unaryop, ast.expr_context))


def _comments(text: str) -> dict[int, str]:
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    return {each.start[0]: each.string for each in tokens if each.type == tokenize.COMMENT}


def _beside(node: ast.stmt, comments: dict[int, str], lines: list[str]) -> Iterator[str]:
    """Yield the comments in the lines of a statement, directly above it, and above the block that it belongs to."""
    for line in range(node.lineno, (node.end_lineno or node.lineno) + 1):
        yield comments.get(line, "")
    line = node.lineno - 1
    while line in comments and lines[line - 1].startswith("#"):
        yield comments[line]
        line -= 1
    while line > 0 and lines[line - 1].strip():
        if lines[line - 1].startswith("#") and lines[line - 1].endswith(":"):
            yield comments[line]
        line -= 1
