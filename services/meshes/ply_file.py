"""Vertices, faces and triangle strips of PLY files, in text or binary, whatever else is in them.

Why no library reads them: docs/decisions/surface-readers.md.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from trocar.services.meshes.announced import cut_off, judge_counts
from trocar.services.meshes.errors import MeshError
from trocar.services.meshes.surface_data import DoubleArray, Int64Array, SurfaceData, strip_triangles

_HEADER_MAX = 1 << 24
_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_CORNERS = ("vertex_indices", "vertex_index")
_NAMES = {"vertex": "vertices", "face": "faces", "tristrips": "strips"}
Values = npt.NDArray[np.float64] | npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class _Property:
    """A number of each row, or a list of numbers behind their count."""

    name: str
    type: str
    count_type: str = ""


@dataclass(slots=True)
class _Element:
    name: str
    rows: int
    properties: list[_Property] = field(default_factory=list)


def read_ply(path: Path) -> SurfaceData:
    """Return vertices and faces, or the triangles of strips.

    Raises MeshError if the header is none, or the file holds less than it announces.
    """
    elements, order, start = _read_header(path)
    announced = {element.name: element.rows for element in elements}
    judge_counts(path, announced.get("face", 0), announced.get("vertex", 0))
    body = _Text(path, start) if not order else _Binary(path, start, order)
    data = SurfaceData(np.zeros((0, 3)), np.zeros(0, np.int64), np.zeros(0, np.int64))
    for element in elements:
        columns = _read_rows(path, body, element)
        if element.name == "vertex":
            data.vertices = _positions(path, columns)
        elif element.name == "face":
            data.corners, data.counts = _lists(path, element, columns)
        elif element.name == "tristrips":
            data.corners = strip_triangles(_lists(path, element, columns)[0]).ravel()
            data.counts = np.full(len(data.corners) // 3, 3)
        if announced.keys() <= _NAMES.keys() and element is elements[-1] and body.rest():
            data.actions.append(f"left {body.rest()} {body.unit} behind the last element unread")
    judge_counts(path, int(np.maximum(data.counts - 2, 0).sum()))
    return data


def _read_header(path: Path) -> tuple[list[_Element], str, int]:
    """Return the elements, the order of bytes (empty for text), and where the data begin."""
    with path.open("rb") as file:
        head = file.read(_HEADER_MAX)
    lines, start = _header_lines(path, head)
    elements: list[_Element] = []
    order = None
    for line in lines:
        match line.split():
            case ["format", name, *_] if name in _ORDERS:
                order = _ORDERS[name]
            case ["element", name, count] if count.isdecimal():
                elements.append(_Element(name, int(count)))
            case ["property", "list", count_type, type_, name] if elements and {count_type, type_} <= _TYPES.keys():
                elements[-1].properties.append(_Property(name, _TYPES[type_], _TYPES[count_type]))
            case ["property", type_, name] if elements and type_ in _TYPES:
                elements[-1].properties.append(_Property(name, _TYPES[type_]))
            case [] | ["ply" | "comment" | "obj_info", *_]:
                pass
            case _:
                raise MeshError(f"{path}: its header has a line that no PLY file has: '{line[:100]}'")
    if order is None:
        raise MeshError(f"{path}: its header does not say which format its data have")
    if not {"face", "tristrips"} & {element.name for element in elements}:
        raise MeshError(f"{path}: does not begin as a PLY file with faces does")
    return elements, order, start


def _header_lines(path: Path, head: bytes) -> tuple[list[str], int]:
    at = head.find(b"end_header")
    while at > 0 and head[at - 1 : at] not in (b"\n", b"\r"):  # a comment may hold these words
        at = head.find(b"end_header", at + 1)
    if at < 0:
        raise MeshError(f"{path}: the file is cut off, its header does not end with 'end_header'")
    start = at + len(b"end_header")
    while start < len(head) and head[start : start + 1] in (b" ", b"\t"):
        start += 1
    start += 2 if head[start : start + 2] == b"\r\n" else 1
    return head[:at].decode("utf-8", "replace").splitlines(), start


class _Text:
    """Numbers in a text, each of size 1."""

    unit = "numbers"

    def __init__(self, path: Path, start: int) -> None:
        with path.open("rb") as file:
            file.seek(start)
            text = file.read().rstrip(b"\0")
        words = text.split()
        try:
            self._numbers = np.array(words, dtype=np.float64) if words else np.zeros(0)
        except ValueError as error:
            raise MeshError(f"{path}: holds what is no number ({error})") from None
        self.at, self.end = 0, len(words)

    def rest(self) -> int:
        return self.end - self.at

    def size(self, _type: str) -> int:
        return 1

    def value(self, at: int, _type: str) -> float:
        return float(self._numbers[at])

    def gather(self, starts: Int64Array, type_: str, count: int) -> Values:
        """Return (rows, count) numbers that begin at `starts`."""
        found: Values = self._numbers[starts[:, None] + np.arange(count)]
        return found


class _Binary:
    """Numbers of so many bytes each."""

    unit = "bytes"

    def __init__(self, path: Path, start: int, order: str) -> None:
        self._data = np.fromfile(path, np.uint8, offset=start)
        self._types = {name: np.dtype(order + name) for name in _TYPES.values()}
        self.at, self.end = 0, len(self._data)

    def rest(self) -> int:
        return self.end - self.at

    def size(self, type_: str) -> int:
        return self._types[type_].itemsize

    def value(self, at: int, type_: str) -> float:
        kind = self._types[type_]
        return float(self._data[at : at + kind.itemsize].view(kind)[0])

    def gather(self, starts: Int64Array, type_: str, count: int) -> Values:
        """Return (rows, count) numbers that begin at `starts`."""
        kind = self._types[type_]
        taken = self._data[starts[:, None] + np.arange(count * kind.itemsize)].view(kind)
        wide: Values = taken.astype(np.float64 if kind.kind == "f" else np.int64)
        return wide


#: By property: of a number (rows,), of a list the counts (rows,) and all items behind one another.
_Columns = dict[str, tuple[Values, Values | None]]


def _read_rows(path: Path, body: _Text | _Binary, element: _Element) -> _Columns:
    """Return the wanted properties of an element, and go behind it.

    Rows mostly have lists of one length: whether all do is seen at once. Else they are walked through.
    """
    least = sum(body.size(each.count_type or each.type) for each in element.properties)
    held = body.rest() // least if least else element.rows
    if held < element.rows:
        raise cut_off(path, element.rows, _NAMES.get(element.name, f"rows of '{element.name}'"), _held(body, element))
    if not element.rows:
        return {}
    places = _alike(body, element) or _walk(path, body, element)
    columns: _Columns = {}
    wanted = {"vertex": ("x", "y", "z")}.get(element.name, _CORNERS if element.name in _NAMES else ())
    for each, (starts, counts) in zip(element.properties, places, strict=True):
        if each.name not in wanted:
            continue
        if not each.count_type:
            columns[each.name] = body.gather(starts, each.type, 1)[:, 0], None
        else:
            columns[each.name] = counts, _gather_lists(body, each, starts, counts)
    return columns


#: By property: where its numbers begin in each row, and how many there are.
_Places = list[tuple[Int64Array, Int64Array]]


def _alike(body: _Text | _Binary, element: _Element) -> _Places | None:
    """Return the places in rows that are all as long as the first; None if they are not."""
    first = _walk_row(body, element, body.at)
    if first is None:
        return None
    end, row = first
    stride = end - body.at
    rows = np.arange(element.rows, dtype=np.int64)
    if body.at + stride * element.rows > body.end:
        return None
    places: _Places = []
    for each, (start, count) in zip(element.properties, row, strict=True):
        starts = start + stride * rows
        if each.count_type:
            told = body.gather(starts - body.size(each.count_type), each.count_type, 1)[:, 0]
            if (told != count).any():
                return None
        places.append((starts, np.full(element.rows, count)))
    body.at += stride * element.rows
    return places


def _walk(path: Path, body: _Text | _Binary, element: _Element) -> _Places:
    starts = np.zeros((element.rows, len(element.properties)), np.int64)
    counts = np.zeros_like(starts)
    at = body.at
    for k in range(element.rows):
        found = _walk_row(body, element, at)
        if found is None:
            raise cut_off(path, element.rows, _NAMES.get(element.name, f"rows of '{element.name}'"), k)
        at = found[0]
        starts[k], counts[k] = zip(*found[1], strict=True)
    body.at = at
    return [(starts[:, k], counts[:, k]) for k in range(len(element.properties))]


def _walk_row(body: _Text | _Binary, element: _Element, at: int) -> tuple[int, list[tuple[int, int]]] | None:
    """Return where a row ends, and where each property's numbers begin and how many they are; None if it is cut off."""
    places = []
    for each in element.properties:
        count = 1
        if each.count_type:
            if at + body.size(each.count_type) > body.end:
                return None
            told = body.value(at, each.count_type)
            at += body.size(each.count_type)
            if not 0 <= told <= body.end - at or told != int(told):
                return None
            count = int(told)
        places.append((at, count))
        at += count * body.size(each.type)
        if at > body.end:
            return None
    return at, places


def _held(body: _Text | _Binary, element: _Element) -> int:
    at, held = body.at, 0
    while (found := _walk_row(body, element, at)) is not None and found[0] > at:
        at, held = found[0], held + 1
    return held


def _gather_lists(body: _Text | _Binary, each: _Property, starts: Int64Array, counts: Int64Array) -> Values:
    """Return the items of all lists, one list behind the other."""
    ends = np.cumsum(counts)
    items: Values = np.zeros(int(ends[-1]), np.float64)
    if body.unit == "bytes":
        items = np.zeros(int(ends[-1]), np.int64)
    for count in np.unique(counts).tolist():
        of_count = np.flatnonzero(counts == count)
        places = (ends[of_count] - count)[:, None] + np.arange(count)
        items[places] = body.gather(starts[of_count], each.type, count)
    return items


def _positions(path: Path, columns: _Columns) -> DoubleArray:
    if not columns:
        return np.zeros((0, 3))
    if {"x", "y", "z"} - columns.keys():
        raise MeshError(f"{path}: its vertices have no x, y and z")
    return np.stack([columns[name][0] for name in ("x", "y", "z")], axis=1).astype(np.float64)


def _lists(path: Path, element: _Element, columns: _Columns) -> tuple[Int64Array, Int64Array]:
    """Return the corners of all lists, and how many each has."""
    if not element.rows:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    counts, items = next((columns[name] for name in _CORNERS if name in columns), (None, None))
    if counts is None or items is None:
        raise MeshError(f"{path}: its {_NAMES[element.name]} do not name vertices")
    whole = items.astype(np.int64)
    if (whole != items).any():
        raise MeshError(f"{path}: a face names vertex {items[whole != items][0]:g}, which is no number of one")
    return whole, counts.astype(np.int64)
