"""A small checkout: a kernel, another that it calls, and a module that neither knows."""

from __future__ import annotations

import shutil
from pathlib import Path

from trocar.services.kernels import kernel_cache

_SERVICES = Path(kernel_cache.__file__).parents[1]
_DECORATOR = "from trocar.services.mechanics.compiled import building_kernel\n"
CALLEE = f"{_DECORATOR}\n@building_kernel\ndef inner(x):\n    return x + 1\n"
_CALLER = (
    f"{_DECORATOR}from trocar.services.parts import (  # brackets )\n    callee,\n)\n\n"
    "inner = callee.inner\n\n@building_kernel\ndef outer(x):\n    return 10 * inner(x)\n"
)
_OURS = (
    *("__init__", "files/__init__", "files/cache_directory", "files/trusted_path", "kernels/__init__"),
    *(f"kernels/{name}" for name in ("kernel_archive", "kernel_cache", "processor", "source_closure")),
    *("mechanics/__init__", "mechanics/compiled/__init__"),
)


def make_checkout(root: Path) -> Path:
    """Make it in a folder that is not there yet, and return the folder."""
    services = root / "trocar" / "services"
    for name in _OURS:
        (services / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(_SERVICES / f"{name}.py", services / f"{name}.py")
    parts = services / "parts"
    parts.mkdir()
    (parts / "__init__.py").touch()
    (parts / "callee.py").write_text(CALLEE)
    (parts / "stranger.py").write_text("X = 1\n")
    (services / "caller.py").write_text(_CALLER)
    return root
