"""Deliberate faults in the code, and how many of them its tests catch: ``python -m benchmarks.mutations``.

For each subject a number of places is drawn (with a fixed seed) in its modules, and each gets one small fault: another
comparison, sign, product, bound or truth, or a number doubled. The subject's tests then run in a copy of the tree until
the first failure. What no test catches is printed with its place, for a person to judge: some faults change nothing
that anybody was promised.
"""

from __future__ import annotations

import ast
import copy
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.report import parse

ROOT = Path(__file__).resolve().parents[1]
#: By subject: modules, and tests.
SUBJECTS = {
    "servo law": (
        [f"services/gateway/servo/{name}.py" for name in ("servo_law", "energy_bound", "slew", "engagement")],
        ["tests/gateway/servo"],
    ),
    "bus": (
        [f"services/runtime/bus/{name}.py" for name in ("bus", "direct", "zmtp", "frame_batches")],
        [f"tests/runtime/bus/test_{name}.py" for name in ("bus", "direct", "frame_batches", "forged_frames")],
    ),
    "attempt": (
        [f"services/training/{name}.py" for name in ("attempt", "errors", "procedure", "score")],
        ["tests/training"],
    ),
}
_COMPARED = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
_COMPUTED = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult}
_BOUNDS = {"min": "max", "max": "min"}
_LONGEST_S = 300.0


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault: where it is, what stood there, and what stands there now."""

    subject: str
    module: str
    line: int
    was: str
    becomes: str
    caught: bool = False
    seconds: float = 0.0


def faulty_nodes(tree: ast.Module) -> Iterator[tuple[ast.AST, ast.AST]]:
    """Yield each node that can have a fault, and the node with it."""
    for node in _below(tree):
        changed = _with_fault(node)
        if changed is not None:
            yield node, changed


def _below(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes of code, without annotations, decorators and texts that are not run."""
    yield node
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "type_params"):
            continue
        for below in value if isinstance(value, list) else [value]:
            if isinstance(below, ast.AST):
                yield from _below(below)


def _with_fault(node: ast.AST) -> ast.AST | None:
    changed = copy.copy(node)
    match node:
        case ast.Compare(ops=[first, *rest]) if type(first) in _COMPARED:
            changed.ops = [_COMPARED[type(first)](), *rest]  # type: ignore[attr-defined]
        case ast.BinOp(op=op) if type(op) in _COMPUTED:
            changed.op = _COMPUTED[type(op)]()  # type: ignore[attr-defined]
        case ast.BoolOp(op=op):
            changed.op = ast.Or() if isinstance(op, ast.And) else ast.And()  # type: ignore[attr-defined]
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            return operand
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return operand
        case ast.Call(func=ast.Name(id=name)) if name in _BOUNDS:
            changed.func = ast.Name(_BOUNDS[name], ast.Load())  # type: ignore[attr-defined]
        case ast.Constant(value=bool(value)):
            changed.value = not value  # type: ignore[attr-defined]
        case ast.Constant(value=int(value) | float(value)):
            changed.value = 2 * value if value else 1  # type: ignore[attr-defined]
        case _:
            return None
    return changed


class _Replace(ast.NodeTransformer):
    """Puts one node in the place of another."""

    def __init__(self, old: ast.AST, new: ast.AST) -> None:
        self._old, self._new = old, new

    def visit(self, node: ast.AST) -> ast.AST:
        return self._new if node is self._old else super().generic_visit(node)


def draw(subject: str, count: int, seed: int) -> list[tuple[str, ast.Module, ast.AST, ast.AST]]:
    """Return so many faults of a subject: module, its tree, and the node without and with the fault."""
    found = []
    for module in SUBJECTS[subject][0]:
        tree = ast.parse((ROOT / module).read_text(encoding="utf-8"))
        found += [(module, tree, *pair) for pair in faulty_nodes(tree)]
    return random.Random(seed).sample(found, min(count, len(found)))


def copy_tree(to: Path) -> None:
    """Copy what git knows of the tree, with its links."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True, text=True).stdout
    for name in filter(None, listed.split("\0")):
        if (ROOT / name).exists():
            (to / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, to / name, follow_symlinks=False)


def is_caught(tree: Path, tests: list[str]) -> bool:
    """Return whether a test fails, or takes too long, in a copy of the tree."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-n0", "-p", "no:cacheprovider", "-m", "not rig", *tests]
    environment = {**os.environ, "PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        done = subprocess.run(command, cwd=tree, env=environment, timeout=_LONGEST_S, capture_output=True, check=False)
    except subprocess.TimeoutExpired:
        return True
    return done.returncode != 0


def run_subject(subject: str, count: int, seed: int, tree: Path) -> Iterator[Fault]:
    """Yield each fault of a subject, with whether it was caught.

    Raises SystemExit if the tests fail without a fault.
    """
    tests = SUBJECTS[subject][1]
    if is_caught(tree, tests):
        raise SystemExit(f"the tests of {subject} fail without any fault")
    for module, parsed, old, new in draw(subject, count, seed):
        file = tree / module
        sound = file.read_bytes()
        file.write_text(_replaced(parsed, old, new), encoding="utf-8")
        began_s = time.monotonic()
        caught = is_caught(tree, tests)
        file.write_bytes(sound)
        line = getattr(old, "lineno", 0)
        yield Fault(subject, module, line, ast.unparse(old), ast.unparse(new), caught, time.monotonic() - began_s)


def _replaced(tree: ast.Module, old: ast.AST, new: ast.AST) -> str:
    """Return the source with the one node, whose tree is as before afterwards."""
    text = ast.unparse(ast.fix_missing_locations(_Replace(old, new).visit(tree)))
    _Replace(new, old).visit(tree)
    return text


def main() -> None:
    """Run it."""
    given = parse(
        __doc__, count=(34, "faults for each subject"), seed=(1, "of the draw"), out=("", "a file for all faults"),
        only=("", "one subject"),
    )  # fmt: skip
    found: list[Fault] = []
    with tempfile.TemporaryDirectory() as folder:
        copy_tree(Path(folder))
        for subject in SUBJECTS:
            if given.only in ("", subject):
                for fault in run_subject(subject, given.count, given.seed, Path(folder)):
                    found.append(fault)
                    print(json.dumps(asdict(fault)), file=sys.stderr, flush=True)
                    if given.out:
                        Path(given.out).write_text(json.dumps([asdict(each) for each in found], indent=1) + "\n")
    for subject in SUBJECTS:
        of = [each for each in found if each.subject == subject]
        if of:
            print(f"{subject}: {sum(each.caught for each in of)} of {len(of)} caught")
    for fault in found:
        if not fault.caught:
            print(f"  {fault.module}:{fault.line}: `{fault.was}` as `{fault.becomes}`")


if __name__ == "__main__":
    main()
