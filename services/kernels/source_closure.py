"""What a module rests on: its own source and that of every module of ours that it imports, directly or not."""

from __future__ import annotations

import functools
import hashlib
import os
import re
from collections.abc import Iterator
from pathlib import Path

PACKAGES = ("trocar", "tests")

_COMMENT = re.compile(r"#[^\n]*|\\\n")
_FROM = re.compile(r"^[ \t]*from[ \t]+(\.*)([\w.]*)[ \t]+import[ \t]*(\([^)]*\)|[^\n]*)", re.MULTILINE)
_IMPORT = re.compile(r"^[ \t]*import[ \t]+([^\n]*)", re.MULTILINE)


class Sources:
    """The modules below a folder, each read once.

    Args:
        root: Path. The folder that holds the packages ``PACKAGES``.
    """

    def __init__(self, root: Path) -> None:
        self._root = root
        self._imports: dict[str, frozenset[str]] = {}
        self._digests: dict[str, bytes] = {}

    def module_of(self, path: Path) -> str | None:
        """Return the dotted name of a file of ours, or None."""
        try:
            parts = path.relative_to(self._root).with_suffix("").parts
        except ValueError:
            return None
        if parts[0] not in PACKAGES:
            return None
        return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)

    def digest(self, module: str) -> str:
        """Return a hash of the sources of ``module`` and of all that it imports, wherever they lie."""
        text = hashlib.sha256()
        for name in sorted(self.closure(module)):
            text.update(name.encode() + b"\0" + self._digests[name])
        return text.hexdigest()

    def closure(self, module: str) -> set[str]:
        """Return ``module`` and the modules of ours that it imports, directly or not, wherever the import stands.

        An import by a name that is made at run time is not seen. The ``__init__`` of a package counts where something
        is imported from it that is no module.
        """
        found: set[str] = set()
        waiting = [module]
        while waiting:
            name = waiting.pop()
            if name not in found:
                found.add(name)
                waiting.extend(self._imports_of(name))
        return found

    def _imports_of(self, module: str) -> frozenset[str]:
        if module not in self._imports:
            path = self._file(module)
            if path is None:
                raise ModuleNotFoundError(f"no module '{module}' below {self._root}")
            source = path.read_bytes()
            package = module if path.name == "__init__.py" else module.rpartition(".")[0]
            self._digests[module] = hashlib.sha256(source).digest()
            self._imports[module] = frozenset(self._targets(source.decode(), package))
        return self._imports[module]

    def _targets(self, source: str, package: str) -> Iterator[str]:
        source = _COMMENT.sub("", source)
        for dots, base, names in _FROM.findall(source):
            if dots:
                above = package.split(".")[: len(package.split(".")) + 1 - len(dots)]
                base = ".".join([*above, base] if base else above)
            for name in names.strip("() \t\n").split(","):
                yield from self._first_module(f"{base}.{name.split()[0]}" if name.strip() else base, base)
        for names in _IMPORT.findall(source):
            for name in names.split(","):
                yield from self._first_module(name.split()[0] if name.strip() else "")

    def _first_module(self, *names: str) -> Iterator[str]:
        yield from [name for name in names if self._file(name)][:1]

    @functools.cache  # noqa: B019 - one object for the life of the process
    def _file(self, module: str) -> Path | None:
        if module.partition(".")[0] not in PACKAGES:
            return None
        stem = os.path.join(self._root, *module.split("."))
        return next((Path(path) for path in (f"{stem}.py", f"{stem}/__init__.py") if os.path.isfile(path)), None)


@functools.cache
def own_sources() -> Sources:
    """Return the modules of the tree that this one lies in."""
    return Sources(Path(__file__).parents[3])
