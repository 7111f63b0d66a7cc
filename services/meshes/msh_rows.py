"""Rows of nodes and elements in a text file of Gmsh, each judged by its place, before they are read.

A reader that goes by counts alone takes what is missing or too much for something else.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from trocar.services.meshes.errors import MeshError

_NODES = {
    1: 2, 2: 3, 3: 4, 4: 4, 5: 8, 6: 6, 7: 5, 8: 3, 9: 6, 10: 9, 11: 10, 12: 27, 13: 18, 14: 14, 15: 1, 16: 8, 17: 20,
    18: 15, 19: 13, 20: 9, 21: 10, 22: 12, 23: 15, 24: 15, 25: 21, 26: 4, 27: 5, 28: 6, 29: 20, 30: 35, 31: 56,
}  # fmt: skip
"""Numbers of nodes by Gmsh's types of elements, of those up to the fifth order."""
_TAGS_AT = 2  # by Gmsh's format of version 2, in a row of an element, after its number and type


class _Section:
    """The rows of a section, taken one by one."""

    def __init__(self, path: Path, name: str, rows: list[tuple[int, list[bytes]]], end: int) -> None:
        self._path, self._name, self._end = path, name, end
        self._rows = iter(rows)
        self.line = end

    def refuse(self, what: str) -> MeshError:
        return MeshError(f"{self._path}: line {self.line}: {what}")

    def next_row(self) -> list[bytes]:
        self.line, row = next(self._rows, (self._end, []))
        if not row:
            raise self.refuse(f"${self._name} ends before all that it announces")
        return row

    def whole_numbers(self) -> list[int]:
        row = self.next_row()
        try:
            return [int(each) for each in row]
        except ValueError:
            raise self.refuse(f"'{_text(row)}' are no whole numbers") from None

    def counts(self, n: int) -> list[int]:
        """Return a row of so many counts and numbers."""
        found = self.whole_numbers()
        if len(found) != n:
            raise self.refuse(f"has {len(found)} numbers, not {n}")
        return found

    def place(self, row: list[bytes], n: int = 3) -> None:
        """Judge coordinates, of a node on a curve or surface with what it is there."""
        if len(row) != n:
            raise self.refuse(f"a node has {len(row)} coordinates, not {n}")
        for each in row:
            try:
                float(each)
            except ValueError:
                raise self.refuse(f"'{_text([each])}' is no coordinate") from None

    def end(self) -> None:
        """Refuse what is there beyond what was announced."""
        self.line, row = next(self._rows, (0, []))
        if row:
            raise self.refuse(f"is more than ${self._name} announces: '{_text(row)}'")


def judge_rows(path: Path, version: str, text: bytes) -> None:
    """Refuse rows of nodes and elements that are not as their section announces; those of version 4.0 are not judged.

    Raises MeshError that names the line.
    """
    if version == "4.0":
        return
    judges = (_nodes_4, _elements_4) if version == "4.1" else (_nodes_2, _elements_2)
    known: set[int] = set()
    for name, section in _sections(path, text):
        if name in ("Nodes", "Elements"):
            judges[name == "Elements"](section, known)
            section.end()


def _sections(path: Path, text: bytes) -> Iterator[tuple[str, _Section]]:
    name, rows = "", list[tuple[int, list[bytes]]]()
    for number, line in enumerate(text.split(b"\n"), 1):
        row = line.split()
        if row and row[0].startswith(b"$"):
            word = row[0].decode("ascii", "replace")
            if name and word != f"$End{name}":
                raise MeshError(f"{path}: line {number}: '{word[:40]}' comes before the end of ${name}")
            if name:
                yield name, _Section(path, name, rows, number)
            name, rows = ("" if word.startswith("$End") else word[1:]), []
        elif row and name in ("Nodes", "Elements"):
            rows.append((number, row))


def _add_node(section: _Section, known: set[int], number: int) -> None:
    if number in known:
        raise section.refuse(f"node {number} is there twice")
    known.add(number)


def _judge_element(section: _Section, known: set[int], kind: int, nodes: list[int]) -> None:
    n = _NODES.get(kind, 0)
    if not n:
        raise section.refuse(f"elements of type {kind} are not known")
    if len(nodes) != n:
        raise section.refuse(f"an element of type {kind} has {len(nodes)} nodes, not {n}")
    for node in nodes:
        if node not in known:
            raise section.refuse(f"an element names node {node}, which is not there")


def _nodes_2(section: _Section, known: set[int]) -> None:
    for _ in range(section.counts(1)[0]):
        row = section.next_row()
        if not row[0].isdigit():
            raise section.refuse(f"'{_text(row[:1])}' is no number of a node")
        _add_node(section, known, int(row[0]))
        section.place(row[1:])


def _elements_2(section: _Section, known: set[int]) -> None:
    for _ in range(section.counts(1)[0]):
        row = section.whole_numbers()
        if len(row) <= _TAGS_AT or row[_TAGS_AT] < 0:
            raise section.refuse(f"element {row[0]} is cut off")
        _judge_element(section, known, row[1], row[_TAGS_AT + 1 + row[_TAGS_AT] :])


def _nodes_4(section: _Section, known: set[int]) -> None:
    blocks, total, _, _ = section.counts(4)
    for _ in range(blocks):
        dimension, _, on_entity, n = section.counts(4)
        for _ in range(n):
            _add_node(section, known, section.counts(1)[0])
        for _ in range(n):
            section.place(section.next_row(), 3 + dimension * bool(on_entity))
    _judge_total(section, len(known), total, "nodes")


def _elements_4(section: _Section, known: set[int]) -> None:
    blocks, total, _, _ = section.counts(4)
    found = 0
    for _ in range(blocks):
        _, _, kind, n = section.counts(4)
        found += n
        for _ in range(n):
            _judge_element(section, known, kind, section.whole_numbers()[1:])
    _judge_total(section, found, total, "elements")


def _judge_total(section: _Section, found: int, total: int, what: str) -> None:
    if found != total:
        raise section.refuse(f"there are {found} {what}, {total} were announced")


def _text(row: Iterable[bytes]) -> str:
    return b" ".join(row)[:40].decode("ascii", "replace")
