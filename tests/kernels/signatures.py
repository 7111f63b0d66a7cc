"""What is compiled in this process."""

from __future__ import annotations

from trocar.services.mechanics.compiled import KERNELS


def compiled_signatures() -> set[str]:
    """Return every kernel of ours that is compiled or loaded, with the types that it takes."""
    return {f"{each.py_func.__qualname__} {types}" for each in KERNELS for types in each.signatures}
