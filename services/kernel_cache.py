"""Where compiled kernels are kept: a folder that belongs to exactly this source.

numba looks at the file of a kernel, not at those of the kernels that it calls: after an update a cached kernel may
go on calling what its neighbour was before. So the folder's name is a hash of everything that holds kernels, and each
version of the source compiles its own. Must be called before numba is imported, which is why `services` itself does.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from pathlib import Path

_SOURCES = ("mechanics", "gateway", "physics", "visualization")
_KEPT = 4


def choose() -> Path:
    """Set ``NUMBA_CACHE_DIR`` for this process and its children, and return it.

    It is ``$NUMBA_CACHE_DIR/<hash>`` where that is set, else ``kernels/<hash>`` in Trocar's cache. Of the folders
    beside it the newest few are kept.
    """
    digest = _digest(Path(__file__).parent)
    root = Path(os.environ.get("NUMBA_CACHE_DIR") or _cache() / "kernels")
    if root.name != digest:
        root = root / digest
    os.environ["NUMBA_CACHE_DIR"] = str(root)
    if not root.is_dir():
        _forget_oldest(root.parent)
    return root


def _cache() -> Path:
    return Path(os.environ.get("TROCAR_CACHE_DIR") or Path.home() / ".cache" / "trocar")


def _digest(folder: Path) -> str:
    text = hashlib.sha256()
    for source in _SOURCES:
        for path in sorted((folder / source).rglob("*.py")):
            text.update(path.relative_to(folder).as_posix().encode())
            text.update(path.read_bytes())
    return f"source-{text.hexdigest()[:16]}"


def _forget_oldest(root: Path) -> None:
    folders = sorted(root.glob("source-*"), key=lambda path: path.stat().st_mtime, reverse=True)
    for folder in folders[_KEPT - 1 :]:
        shutil.rmtree(folder, ignore_errors=True)  # another process may still be writing there: next time
