"""Binary files since the last release: ``python -m tests.package.binary_changes``.

Each version of a binary file stays in every clone for ever. So what is made from the code, as pictures and recordings,
is made at a release; other changes together add or alter at most `MOST_BYTES` between two releases, the working tree
included. Two changes of 60 kB cost as much as one of 120 kB, and a file that is written twice is counted twice.

A release is a commit that changes `project.version` in pyproject.toml, or has a tag as v1.2.3; what it brings itself is
free. Counting begins with the commit that brought this file: what older ones hold stays as it is. In a shallow clone it
begins, at the earliest, with the first commit that is there. Where there is no history, nothing can be counted.
"""

from __future__ import annotations

import io
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).parents[2]
MOST_BYTES = 100_000
_PROJECT = "pyproject.toml"
_TAGS = "v[0-9]*"


@dataclass(frozen=True)
class Changes:
    """Binary files that have come since a commit.

    Attributes
    ----------
    since
        What the commit is, with its short hash.
    sizes
        Path and bytes of each new version of a binary file, the largest first.
    """

    since: str
    sizes: list[tuple[str, int]] = field(default_factory=list)

    @property
    def total(self) -> int:
        """Bytes of all of them."""
        return sum(size for _, size in self.sizes)

    def __str__(self) -> str:
        listed = ", ".join(f"{path} {size / 1e3:.0f} kB" for path, size in self.sizes[:5])
        return f"{self.total / 1e3:.0f} kB of binary files since {self.since}, of {MOST_BYTES / 1e3:.0f} kB" + (
            f": {listed}" if listed else ""
        )


class Repository:
    """A work tree, and what git says of it."""

    def __init__(self, root: Path) -> None:
        self._root = root

    def git(self, *arguments: str, given: str | None = None) -> bytes:
        """Return what a command of git prints; raises CalledProcessError."""
        command = ["git", "-C", str(self._root), *arguments]
        return subprocess.run(command, check=True, capture_output=True, input=given and given.encode()).stdout

    def lines(self, *arguments: str) -> list[str]:
        """Return the lines that a command of git prints."""
        return self.git(*arguments).decode().splitlines()

    def has_history(self) -> bool:
        """Return whether this is the top of a work tree with a commit, and not a folder in somebody else's."""
        try:
            (top,) = self.lines("rev-parse", "--show-toplevel")
            self.git("rev-parse", "--verify", "HEAD")
        except (OSError, subprocess.CalledProcessError):
            return False
        return Path(top).resolve() == self._root.resolve()

    def version(self, commit: str) -> str:
        """Return the version of the project at a commit, empty where it has none."""
        try:
            text = self.git("show", f"{commit}:{_PROJECT}").decode()
        except subprocess.CalledProcessError:
            return ""
        return _version(text)

    def version_here(self) -> str:
        """Return the version of the project in the work tree."""
        path = self._root / _PROJECT
        return _version(path.read_text()) if path.exists() else ""

    def release(self) -> str | None:
        """Return the newest commit that changed the version, None for none."""
        for row in self.lines("log", "--format=%H %P", "--full-history", "--", _PROJECT):
            commit, *parents = row.split()
            if all(self.version(parent) != self.version(commit) for parent in parents):
                return commit
        return None

    def tag(self) -> str | None:
        """Return the newest commit with a tag of a release, None for none."""
        try:
            (name,) = self.lines("describe", "--tags", "--abbrev=0", "--match", _TAGS)
        except subprocess.CalledProcessError:
            return None
        return self.lines("rev-parse", f"{name}^{{commit}}")[0]

    def beginning(self, rule: str) -> str:
        """Return the first commit that brought the file of this rule, or HEAD where none has yet."""
        brought = self.lines("log", "--format=%H", "--diff-filter=A", "--", rule)
        return (brought or self.lines("rev-parse", "HEAD"))[-1]

    def since(self, rule: str) -> tuple[str, str]:
        """Return the commit after which changes are counted, and what it is."""
        found = [
            (self.beginning(rule), "this rule"),
            (self.release(), "the last version"),
            (self.tag(), "the last tag"),
        ]
        known = [(commit, what) for commit, what in found if commit]
        return min(known, key=lambda each: int(self.lines("rev-list", "--count", f"{each[0]}..HEAD")[0]))

    def committed(self, since: str) -> Iterator[tuple[str, bytes]]:
        """Yield path and content of each version of a file that came after a commit."""
        listed = (row.partition(" ") for row in self.lines("rev-list", "--objects", f"{since}..HEAD"))
        paths = {name: path for name, _, path in listed if path}
        told = io.BytesIO(self.git("cat-file", "--batch", given="\n".join(paths)))
        while head := told.readline():
            name, kind, size = head.decode().split()
            data = told.read(int(size) + 1)[:-1]
            if kind == "blob":
                yield paths[name], data

    def uncommitted(self) -> Iterator[tuple[str, bytes]]:
        """Yield path and content of each file that differs from the last commit, or is not in it and not ignored."""
        changed = self.git("diff", "--name-only", "-z", "HEAD") + self.git(
            "ls-files", "-z", "--others", "--exclude-standard"
        )
        for name in filter(None, changed.decode().split("\0")):
            path = self._root / name
            if path.is_file() and not path.is_symlink():
                yield name, path.read_bytes()


def binary_changes(root: Path = ROOT, rule: str = f"{Path(__file__).relative_to(ROOT)}") -> Changes | None:
    """Return the binary files that have come since the last release, None where there is no history."""
    repository = Repository(root)
    if not repository.has_history():
        return None
    since, what = repository.since(rule)
    if repository.version_here() != repository.version("HEAD"):
        return Changes(f"a release in preparation, {repository.version_here()}")
    files = [*repository.committed(since), *repository.uncommitted()]
    sizes = sorted(((path, len(data)) for path, data in files if _is_binary(data)), key=lambda each: -each[1])
    return Changes(f"{since[:8]} ({what})", sizes)


def _version(text: str) -> str:
    return str(tomllib.loads(text).get("project", {}).get("version", ""))


def _is_binary(data: bytes) -> bool:
    try:
        data.decode()
    except UnicodeDecodeError:
        return True
    return b"\0" in data


def main() -> int:
    """Say what has come, and return 1 if that is too much."""
    found = binary_changes()
    if found is None:
        print("binary files are not counted: there is no history of git here")
        return 0
    is_too_much = found.total > MOST_BYTES
    print(found, "; leave them to the next release, or make them text or smaller" if is_too_much else "", sep="")
    return int(is_too_much)


if __name__ == "__main__":
    sys.exit(main())
