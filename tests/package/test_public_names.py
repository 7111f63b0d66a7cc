"""Each class of ours that a public signature names is public itself: found by walking the annotations."""

from __future__ import annotations

import ast
import importlib
import inspect
import sys
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import trocar
import trocar.envs
from trocar import front

NAMED_ONLY = front.NAMED_ONLY | trocar.envs.NAMED_ONLY
PAGE = (Path(__file__).parents[2] / "docs" / "reference" / "names.md").read_text(encoding="utf-8")


def _names_of(module: str) -> dict[str, Any]:
    """Return what annotations in a module may name: with what it imports for type checkers alone."""
    names = {**vars(typing), **vars(sys.modules[module])}
    for node in ast.walk(ast.parse(inspect.getsource(sys.modules[module]))):
        for alias in node.names if isinstance(node, ast.ImportFrom) and node.module else ():
            if (alias.asname or alias.name) not in names:
                names[alias.asname or alias.name] = getattr(importlib.import_module(node.module or ""), alias.name)
    return names


def _hints(of: Any, module: str, annotations: dict[str, Any]) -> dict[str, Any]:
    """Return annotations that stand in one module, evaluated."""
    bare = type(str(of), (), {"__annotations__": annotations, "__module__": module})
    return typing.get_type_hints(bare, _names_of(module))


def _annotations(of: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Yield what the public signatures and attributes of an object are annotated with, and where."""
    if inspect.isfunction(of):
        for key, hint in _hints(name, of.__module__, of.__annotations__).items():
            yield f"{name}({key})", hint
        return
    for kind in (each for each in of.__mro__ if each.__module__.startswith("trocar.")):
        own = {key: each for key, each in vars(kind).get("__annotations__", {}).items() if not key.startswith("_")}
        for key, hint in _hints(name, kind.__module__, own).items():
            yield f"{name}.{key}", hint
        for key, member in vars(kind).items():
            function = inspect.unwrap(getattr(member, "fget", None) or getattr(member, "__func__", None) or member)
            is_written = inspect.isfunction(function) and function.__code__.co_filename != "<string>"
            if is_written and (key == "__init__" or not key.startswith("_")):
                yield from _annotations(function, f"{name}.{key}")


def _classes(hint: Any) -> Iterator[type]:
    """Yield the classes of ours in an annotation."""
    if isinstance(hint, list | tuple):
        parts: tuple[Any, ...] = tuple(hint)
    else:
        parts = (typing.get_origin(hint), *typing.get_args(hint)) if typing.get_origin(hint) else ()
    for part in parts:
        yield from _classes(part)
    if not parts and isinstance(hint, type) and hint.__module__.startswith("trocar."):
        yield hint


def _named_but_hidden(names: dict[str, Any]) -> dict[type, str]:
    public = {getattr(module, name) for module in (trocar, trocar.envs) for name in module.__all__}
    hidden: dict[type, str] = {}
    for name, of in names.items():
        for where, hint in _annotations(of, name):
            hidden |= {kind: where for kind in _classes(hint) if kind not in public}
    return hidden


def test_what_public_signatures_name_is_public() -> None:
    """Not walked is what is public for that reason alone: what it shows in turn changes with any release."""
    names = {n: getattr(m, n) for m in (trocar, trocar.envs) for n in m.__all__ if n not in NAMED_ONLY}
    assert _named_but_hidden(names) == {}


def test_a_class_that_a_signature_hides_would_be_found() -> None:
    hidden = _named_but_hidden({"DuctBody": trocar.DuctBody})
    assert "ModalIntegrator" in {kind.__name__ for kind in hidden}


def test_nothing_is_public_as_named_that_no_signature_names() -> None:
    named = {
        kind.__name__
        for module in (trocar, trocar.envs)
        for name in set(module.__all__) - NAMED_ONLY
        for _, hint in _annotations(getattr(module, name), name)
        for kind in _classes(hint)
    }
    assert sorted(NAMED_ONLY - named) == []


def test_the_front_door_lists_what_it_opens_and_the_page_lists_it() -> None:
    assert trocar.__all__ == front.__all__
    for module in (trocar, trocar.envs):
        missing = [name for name in module.__all__ if f"`{name}`" not in PAGE]
        assert not missing, missing
