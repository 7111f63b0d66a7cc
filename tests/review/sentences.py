"""The sentences of Python sources that people read, as keys of the catalogues of translations."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from itertools import count
from pathlib import Path

#: Calls whose texts nobody at a page reads: of logs, settings, patterns, and of a database.
_APART = {"Field", "warning", "info", "debug", "compile", "match", "fullmatch", "execute", "exec_driver_sql", "print"}
#: At least two words.
_SENTENCE = re.compile(r"[A-Za-z]+[ ,:;]+.*[a-z]{2,}", re.DOTALL)


def texts_of(node: ast.AST) -> Iterator[str]:
    """Yield the texts that an expression may have, with ``{}`` for values in them."""
    match node:
        case ast.Constant(value=str(text)):
            yield text
        case ast.JoinedStr(values=values):
            yield "".join(part.value if isinstance(part, ast.Constant) else "{}" for part in values)  # type: ignore[misc]
        case ast.IfExp(body=body, orelse=other):
            yield from (*texts_of(body), *texts_of(other))
        case ast.BoolOp(values=values) | ast.Tuple(elts=values) | ast.Dict(values=values):
            for each in values:
                yield from texts_of(each)


def numbered(text: str) -> str:
    """Return a text with ``{0}``, ``{1}`` and so on for each ``{}``."""
    numbers = count()
    return re.sub(r"\{\}", lambda _: f"{{{next(numbers)}}}", text)


def sentences(path: Path, *, within: tuple[str, ...] = ()) -> set[str]:
    """Return every text of two words or more in a file, but for its documentation; or those of some functions of it."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    roots = [node for node in ast.walk(tree) if getattr(node, "name", "") in within] if within else [tree]
    left_out = {id(part) for node in ast.walk(tree) for part in _unread(node)}
    found = [node for root in roots for node in ast.walk(root) if isinstance(node, ast.Constant | ast.JoinedStr)]
    told = (text for node in found if id(node) not in left_out for text in texts_of(node))
    return {numbered(text) for text in told if " " in text.strip() and _SENTENCE.search(text)}


def raised(path: Path) -> set[str]:
    """Return the sentences with which a file raises errors of people."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    calls = [node.exc for node in ast.walk(tree) if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call)]
    return {numbered(text) for call in calls for argument in call.args for text in texts_of(argument) if " " in text}


def told_to(path: Path, calls: set[str]) -> set[str]:
    """Return the texts that a file gives first to calls of these names."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    told = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and node.args and _name_of(node) in calls]
    return {numbered(text) for call in told for text in texts_of(call.args[0])}


def _name_of(call: ast.Call) -> str:
    """Return the last part of the name of what is called."""
    return str(getattr(call.func, "attr", getattr(call.func, "id", "")))


def _unread(node: ast.AST) -> Iterator[ast.AST]:
    """Yield what of a node nobody reads as a sentence of its own."""
    match node:
        case ast.Expr(value=ast.Constant() as text):  # a docstring
            yield text
        case ast.Call() if _name_of(node) in _APART:
            yield from ast.walk(node)
        case ast.JoinedStr(values=values):
            yield from values
        case ast.AnnAssign(annotation=annotation) | ast.arg(annotation=ast.AST() as annotation):
            yield from ast.walk(annotation)
