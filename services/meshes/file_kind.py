"""Which format a surface file has: told by what is in it. Its name is asked where that tells nothing."""

from __future__ import annotations

import codecs
import re
from pathlib import Path

from trocar.services.foreign_files.known_kinds import find_known_kind
from trocar.services.meshes.errors import MeshError

READABLE = (".stl", ".obj", ".ply", ".vtp", ".vtu", ".msh", ".inp")
HEAD_BYTES = 1 << 16
_BEHIND_BYTES = 8192
#: Bytes of a binary STL, by the format of 3D Systems: of the header before the count, and of each triangle.
STL_HEADER, STL_TRIANGLE = 80, 50
_GRID = re.compile(rb"<VTKFile[^>]*\btype\s*=\s*[\"']UnstructuredGrid")
_MSH = re.compile(rb"^\$MeshFormat\s", re.MULTILINE)
_INP = re.compile(rb"^\*(node|heading|part|include)\b", re.MULTILINE | re.IGNORECASE)
_VERTEX_LINE = re.compile(rb"^[ \t]*v([ \t]+[-+.\deE]+){3}", re.MULTILINE)


def find_kind(path: Path, head: bytes, size: int) -> str:
    """Return ``stl``, ``text stl``, ``obj``, ``ply``, ``vtp``, ``vtu``, ``msh`` or ``inp``.

    Raises MeshError that says what the file is instead.
    """
    known = find_known_kind(head)
    if known:
        raise MeshError(f"{path}: is no surface but {known}")
    text = plain_text(head).lstrip()
    if re.match(rb"ply\s", text):
        return "ply"
    if b"<VTKFile" in text and text.startswith(b"<"):
        return "vtu" if _GRID.search(text) else "vtp"
    if text.startswith(b"$MeshFormat") or _MSH.search(text):
        return "msh"
    has_text = b"\0" not in head[: STL_HEADER + 4] or head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    if has_text and text[:5].lower() == b"solid":
        return "text stl"
    if has_text and _VERTEX_LINE.search(text):
        return "obj"
    if has_text and _INP.search(text):
        return "inp"
    if not has_text and _is_binary_stl(head, size):
        return "stl"
    return _by_name(path)


def _is_binary_stl(head: bytes, size: int) -> bool:
    """Return whether the number of triangles fits the size, but for a little behind them."""
    wanted = STL_HEADER + 4 + STL_TRIANGLE * int.from_bytes(head[STL_HEADER : STL_HEADER + 4], "little")
    return wanted > STL_HEADER + 4 and wanted <= size <= wanted + _BEHIND_BYTES


def plain_text(data: bytes) -> bytes:
    """Return a text without a byte order mark, in UTF-8."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return data.decode("utf-16", "replace").encode()
    return data.removeprefix(codecs.BOM_UTF8)


def _by_name(path: Path) -> str:
    suffix = path.suffix.lower()
    if suffix not in READABLE:
        raise MeshError(f"{path}: cannot read '{path.suffix}' files; readable: {', '.join(READABLE)}")
    if suffix in (".ply", ".vtp", ".vtu", ".msh", ".inp"):
        raise MeshError(f"{path}: does not begin as a {suffix[1:].upper()} file does")
    return suffix[1:]
