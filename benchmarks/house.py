"""The size of the house by package, in the tree or in a commit: ``python -m benchmarks.house --revision HEAD``.

Lines and files of Python; tuned constants, which are names in capitals with a number on the right; words of documents;
names of numba's private modules, of which `tests/test_house.py` allows none.
"""

from __future__ import annotations

import re
import subprocess
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.report import parse

ROOT = Path(__file__).parents[1]
_CONSTANT = re.compile(r"^_?[A-Z][A-Z_0-9]+(?:, _?[A-Z][A-Z_0-9]+)*(?:: [\w\[\], ]+)? = .*\d", re.MULTILINE)
#: Modules that numba does not document for extensions.
_PRIVATE_NUMBA = re.compile(r"\bnumba\.(?:core|cpython|np|misc|typed|targets)\b")
_MECHANICS = "services/mechanics"


@dataclass(slots=True)
class House:
    """What was counted, by package."""

    files: Counter[str] = field(default_factory=Counter)
    lines: Counter[str] = field(default_factory=Counter)
    constants: Counter[str] = field(default_factory=Counter)
    words: int = 0
    private_numba: int = 0

    def of(self, package: str) -> tuple[int, int, int]:
        """Return files, lines and constants of a package and of all that it contains."""
        inside = [name for name in self.lines if name == package or name.startswith(f"{package}/")]
        return tuple(sum(each[name] for name in inside) for each in (self.files, self.lines, self.constants))  # type: ignore[return-value]


def count(revision: str | None = None) -> House:
    """Count the tracked files of a commit, or of the working tree."""
    house = House()
    for name, text in _texts(revision):
        if name.endswith(".md") and name.startswith("docs/"):
            house.words += len(text.split())
        elif name.endswith(".py"):
            package = _package(name)
            house.files[package] += 1
            house.lines[package] += text.count("\n")
            house.constants[package] += len(_CONSTANT.findall(text))
            if name.startswith("services/"):
                house.private_numba += len(_PRIVATE_NUMBA.findall(text))
    return house


def _package(name: str) -> str:
    parts = name.split("/")[:-1]
    return "/".join(parts[: 3 if name.startswith(_MECHANICS) else 2 if parts[:1] == ["services"] else 1])


def _texts(revision: str | None) -> Iterator[tuple[str, str]]:
    listed = ["ls-files", "--cached", "--others", "--exclude-standard"]
    names = _git(*listed if revision is None else ["ls-tree", "-r", "--name-only", revision]).splitlines()
    for name in names:
        if not name.endswith((".py", ".md")):
            continue
        if revision is not None:
            yield name, _git("show", f"{revision}:{name}")
        elif (ROOT / name).exists():
            yield name, (ROOT / name).read_text()


def _git(*arguments: str) -> str:
    return subprocess.run(["git", "-C", str(ROOT), *arguments], check=True, capture_output=True, text=True).stdout


def table(house: House) -> Iterator[str]:
    """Yield the rows of a table, the largest package first."""
    yield "| package | files | lines | tuned constants |"
    yield "| --- | ---: | ---: | ---: |"
    whole = ("services", _MECHANICS, "studies", "protocol", "tests", "benchmarks")
    packages = sorted(set(house.lines) - set(whole), key=lambda name: -house.lines[name])
    for name in (*whole, *packages):
        files, lines, constants = house.of(name)
        yield f"| {'**' + name + '**' if name in whole else name} | {files:,} | {lines:,} | {constants:,} |"
    yield ""
    yield f"Words of documents: {house.words:,}. Names of numba's private modules in `services`: {house.private_numba}."


if __name__ == "__main__":
    given = parse(__doc__, revision=("", "a commit; without it the working tree"))
    print("\n".join(table(count(given.revision or None))))
