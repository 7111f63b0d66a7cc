"""Recorded messages as columns: one name for each number of a body, one row for each message."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from trocar.protocol.arrays import Array
from trocar.protocol.fields import FieldForm, fields
from trocar.protocol.table import TableRow
from trocar.services.recordings.errors import RecordingError
from trocar.services.recordings.reader import read_messages

Values = npt.NDArray[Any]


@dataclass(slots=True)
class TopicColumns:
    """What the messages of one topic hold.

    Attributes:
        time_ns: Wall clock, one for each message.
        values: By name, such as ``instruments.left.position_m`` or ``duct.q``: what each message that has it holds of
            it.
        rows: By name: which messages those are.
    """

    time_ns: list[int] = field(default_factory=list)
    values: dict[str, list[Any]] = field(default_factory=dict)
    rows: dict[str, list[int]] = field(default_factory=dict)

    def add(self, time_ns: int, body: msgspec.Struct) -> None:
        """Append a message."""
        row = len(self.time_ns)
        self.time_ns.append(time_ns)
        for name, value in numbers(body):
            self.values.setdefault(name, []).append(value)
            self.rows.setdefault(name, []).append(row)

    def arrays(self) -> dict[str, Values]:
        """Return an array by name, first axis the messages; time in s since the first.

        Of what differs in size from message to message, as contacts do, all values follow one another, and
        ``<name>.first`` (messages + 1,) says where those of each message begin.
        """
        found: dict[str, Values] = {"time_s": (np.array(self.time_ns) - self.time_ns[0]) * 1e-9}
        for name, values in self.values.items():
            if self._is_regular(name):
                found[name] = np.array(values)
                continue
            parts: list[Values] = [np.zeros((0, *np.shape(values[0])[1:]))] * len(self.time_ns)
            for row, value in zip(self.rows[name], values, strict=True):
                parts[row] = np.atleast_1d(value)
            found[name] = np.concatenate(parts)
            found[f"{name}.first"] = np.cumsum([0, *map(len, parts)])
        return found

    def flat(self) -> dict[str, Values]:
        """Return a column (messages,) by name for each number that every message has; time in s since the first."""
        columns: dict[str, Values] = {}
        for name, array in self.arrays().items():
            if (name in self.values and not self._is_regular(name)) or name.endswith(".first"):
                continue
            for place in np.ndindex(array.shape[1:]):
                columns[".".join((name, *map(str, place)))] = array[(slice(None), *place)]
        return columns

    def _is_regular(self, name: str) -> bool:
        values = self.values[name]
        return len(values) == len(self.time_ns) and len({np.shape(value) for value in values}) == 1


def read_columns(path: Path, topics: Collection[str] = ()) -> dict[str, TopicColumns]:
    """Return the columns of each topic that a recording has messages of.

    Raises RecordingError if it is no recording, or has no message of any of the topics.
    """
    found: dict[str, TopicColumns] = {}
    for topic, time_ns, body in read_messages(path, topics):
        found.setdefault(topic, TopicColumns()).add(time_ns, body)
    if not found:
        raise RecordingError(f"{path}: holds no message of {', '.join(topics) or 'any topic'}")
    return found


def numbers(body: msgspec.Struct) -> Iterator[tuple[str, Any]]:
    """Yield name and value of all that a body holds: numbers, words and arrays."""
    for name, expand in _expansions(type(body)):
        yield from expand(name, getattr(body, name))


Expand = Callable[[str, Any], Iterator[tuple[str, Any]]]


@cache
def _expansions(kind: type[msgspec.Struct]) -> tuple[tuple[str, Expand], ...]:
    return tuple((each.name, _expansion(each.form, each.spec.row if each.spec else None)) for each in fields(kind))


def _expansion(form: FieldForm, row: type[msgspec.Struct] | None) -> Expand:
    if form is FieldForm.ARRAY:
        return _array if row is None else lambda name, table: _rows(name, table, row)
    if form is FieldForm.MANY:
        return _many
    return _map if form is FieldForm.MAP else _one


def _one(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, msgspec.Struct):
        yield from ((f"{name}.{inner}", each) for inner, each in numbers(value))
    elif value is not None:
        yield name, value


def _many(name: str, values: tuple[Any, ...]) -> Iterator[tuple[str, Any]]:
    for place, value in enumerate(values):
        yield from _one(f"{name}.{getattr(value, 'name', place)}", value)


def _map(name: str, values: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    for key, value in values.items():
        yield from _one(f"{name}.{key}", value)


def _array(name: str, value: Array) -> Iterator[tuple[str, Any]]:
    yield name, value.view()


def _rows(name: str, table: Array, row: type[msgspec.Struct]) -> Iterator[tuple[str, Any]]:
    assert issubclass(row, TableRow)
    for place, each in enumerate(table.view().tolist()):
        yield from _one(f"{name}.{place}", row.from_row(each))
