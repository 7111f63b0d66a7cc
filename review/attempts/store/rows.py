"""Rows read as records: all by one question, and where bytes in them were changed, all but the damaged ones."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from typing import Any, Protocol, TypeVar

import msgspec
from sqlalchemy import RowMapping, Select, select
from sqlalchemy.exc import DBAPIError

from trocar.review.attempts.store.database import Database, StoreError
from trocar.review.attempts.store.tables import StoredAttempt

Query = Select[*tuple[Any, ...]]
#: What a row raises whose bytes are not those that were written.
DAMAGED = (DBAPIError, TypeError, ValueError, zlib.error)
_NAMED = 10  # so that a message stays a sentence


class Record(Protocol):
    """A row of an attempt."""

    @property
    def id(self) -> int:
        """Number of the attempt."""

    @property
    def began_ns(self) -> int:
        """Moment of its first motion."""


_Record = TypeVar("_Record", bound=Record)


def read_rows(database: Database, kind: type[_Record], query: Query) -> tuple[list[_Record], list[int]]:
    """Return what a query finds, oldest first, and the numbers of attempts whose rows are damaged."""
    ordered = query.order_by(StoredAttempt.began_ns, StoredAttempt.id)
    try:
        with database.reading() as session:
            return [to_record(kind, row) for row in session.execute(ordered).mappings()], []
    except (StoreError, *DAMAGED):
        found, damaged = _one_by_one(database, kind, query)
    return sorted(found, key=lambda each: (each.began_ns, each.id)), damaged


def _one_by_one(database: Database, kind: type[_Record], query: Query) -> tuple[list[_Record], list[int]]:
    found, damaged = [], []
    with database.reading() as session:
        numbers = list(session.scalars(select(StoredAttempt.id)))
    for number in numbers:
        try:
            with database.reading() as session:
                row = session.execute(query.where(StoredAttempt.id == number)).mappings().first()
            if row is not None:
                found.append(to_record(kind, row))
        except (StoreError, *DAMAGED):
            damaged.append(number)
    return found, damaged


def to_record(kind: type[_Record], row: RowMapping) -> _Record:
    """Return a row as a record. Raises one of `DAMAGED` if something in it is of another type."""
    return msgspec.convert(dict(row), kind)


def unreadable(numbers: Sequence[int]) -> str:
    """Return a sentence on attempts whose rows are damaged."""
    named = ", ".join(map(str, numbers[:_NAMED])) + (
        f" and {len(numbers) - _NAMED} more" if len(numbers) > _NAMED else ""
    )
    one = len(numbers) == 1
    return (
        f"attempt{'' if one else 's'} {named} cannot be read: the database is damaged there; `trocar score` of "
        f"{'its recording' if one else 'their recordings'} keeps {'it' if one else 'them'} anew"
    )
