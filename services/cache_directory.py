"""Where bases, meshes and compiled kernels are kept between runs."""

from __future__ import annotations

import os
from pathlib import Path


def cache_directory() -> Path:
    """Return ``$TROCAR_CACHE_DIR``, else ``~/.cache/trocar``; whether there is such a folder is another question."""
    return Path(os.environ.get("TROCAR_CACHE_DIR") or Path.home() / ".cache" / "trocar")
