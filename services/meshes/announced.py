"""What is judged of a surface file before its triangles are read: its place, and how many it says that it has."""

from __future__ import annotations

import stat
from pathlib import Path

from trocar.services.meshes.errors import MeshError

MOST_TRIANGLES_READ = 2_000_000
"""Reading and repairing takes about a kilobyte and 10 to 30 µs a triangle."""
MOST_VERTICES_READ = 3 * MOST_TRIANGLES_READ
"""As many as triangles that share none have."""
BYTES_READ = 1_000  # a triangle, as above
MOST_FILE_BYTES = 2 << 30
"""Text of so many triangles takes a third of that."""


def judge_place(path: Path) -> None:
    """Refuse what is no file, or one that this user may not read.

    Raises MeshError that names the file and the reason.
    """
    try:
        status = path.stat()
        mode = status.st_mode
        if stat.S_ISREG(mode):
            path.open("rb").close()
    except FileNotFoundError:
        raise MeshError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:  # a closed folder; a name that no file can have
        raise MeshError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if not stat.S_ISREG(mode):
        raise MeshError(f"{path}: is a {'folder' if stat.S_ISDIR(mode) else 'device or a pipe'}, not a file")
    if status.st_size > MOST_FILE_BYTES:
        size, most = (f"{1e-9 * n_bytes:.2g} GB" for n_bytes in (status.st_size, MOST_FILE_BYTES))
        raise MeshError(f"{path}: has {size}, at most {most} are read")


def judge_counts(path: Path, triangles: int, vertices: int = 0) -> None:
    """Refuse a file of more triangles or vertices than are read.

    Raises MeshError that names the file and the numbers.
    """
    if triangles > MOST_TRIANGLES_READ:
        raise MeshError(
            f"{path}: about {triangles:.3g} triangles, which take {1e-9 * BYTES_READ * triangles:.2g} GB to repair; at "
            f"most {MOST_TRIANGLES_READ:.3g} are read, decimate the surface first"
        )
    if vertices > MOST_VERTICES_READ:
        raise MeshError(f"{path}: announces {vertices:.3g} vertices, at most {MOST_VERTICES_READ:.3g} are read")


def cut_off(path: Path, announced: int, what: str, held: int) -> MeshError:
    """Return the refusal of a file that announces more than it holds."""
    return MeshError(f"{path}: the file is cut off, it announces {announced} {what} and holds {held}")
