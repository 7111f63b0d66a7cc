"""Attempts in a database: added, listed, exported and erased."""

from __future__ import annotations

import csv
import hashlib
import io
import re
import time
import warnings
import zlib
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

import msgspec
from sqlalchemy import select, update
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.orm import Session

from trocar.review.attempts.assessment import Assessment
from trocar.review.attempts.report import Past
from trocar.review.attempts.store.database import ENVIRONMENT, Database, StoreError, UnknownError, default_url
from trocar.review.attempts.store.erasing import erase_rows, number_of, plan_erasure
from trocar.review.attempts.store.migrate import migrate
from trocar.review.attempts.store.recordings import Erased, Plan, from_stored, reason_of, remove, to_stored
from trocar.review.attempts.store.rows import DAMAGED, Query, read_rows, to_record, unreadable
from trocar.review.attempts.store.tables import Note, StoredAttempt, Trainee

__all__ = ["ENVIRONMENT", "Listed", "Store", "StoreError", "UnknownError", "default_url"]
_PSEUDONYM = re.compile(r"[a-z0-9][a-z0-9._-]{0,63}", re.IGNORECASE | re.ASCII)
_LISTED = (
    StoredAttempt.id, Trainee.pseudonym.label("trainee"), StoredAttempt.scenario, StoredAttempt.began_ns,
    StoredAttempt.outcome, StoredAttempt.counts, StoredAttempt.time_s, StoredAttempt.total, StoredAttempt.percent,
    StoredAttempt.errors, StoredAttempt.critical, StoredAttempt.recording,
)  # fmt: skip
_WHOLE = (
    StoredAttempt.id, Trainee.pseudonym.label("trainee"), StoredAttempt.began_ns, StoredAttempt.recording,
    StoredAttempt.assessment,
)  # fmt: skip
_INSERTS: dict[str, Callable[..., Any]] = {"sqlite": sqlite.insert, "postgresql": postgresql.insert}
_LARGEST_NUMBER = 2**31 - 1  # as PostgreSQL's integer


class Listed(msgspec.Struct, frozen=True):
    """A row of the list."""

    id: int
    trainee: str
    scenario: str
    began_ns: int
    outcome: str
    counts: bool
    time_s: float
    total: float | None
    percent: float | None
    errors: int
    critical: int
    recording: str


class Said(msgspec.Struct, frozen=True):
    """A note: `data` is what its kind has."""

    attempt: int | None
    trainee: str
    kind: str
    by: str
    at_ns: int
    data: Any


class _Whole(msgspec.Struct, frozen=True):
    """A row with all that is known of an attempt."""

    id: int
    trainee: str
    began_ns: int
    recording: str
    assessment: bytes


_Record = TypeVar("_Record", Listed, _Whole)


def _look_at_pseudonym(trainee: str) -> None:
    """Raise StoreError if a trainee cannot be called so."""
    if not _PSEUDONYM.fullmatch(trainee):
        raise UnknownError(f"{trainee!r} is no pseudonym: letters, digits, '.', '_' and '-', at most 64")


class Store:
    """A database of attempts, brought to the present tables when it is opened; any number of processes may use it.

    Raises StoreError: one sentence, without the password, if the database cannot be used.

    Args:
        url: Address, or file of SQLite; None: where this user's attempts are kept.
        create: Whether a file that is not there is made.
        tell: Called with a sentence on rows that cannot be read; all others are.
    """

    def __init__(
        self, url: str | None = None, *, create: bool = True, tell: Callable[[str], object] = warnings.warn
    ) -> None:
        self._database = Database(url or default_url(), create=create)
        self._engine = self._database.engine
        self._tell = tell
        try:
            migrate(self._database)
        except BaseException:
            self._database.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._database.close()

    def add(self, found: Assessment, trainee: str, recording: Path) -> int:
        """Keep an attempt, in the place of an earlier judgement of the same one; return its number."""
        _look_at_pseudonym(trainee)
        key, values = _key(found), _values(found, recording)
        with self._database.writing() as session:
            values["trainee_id"] = self._trainee_id(session, trainee)
            same = update(StoredAttempt).where(StoredAttempt.key == key).values(values).returning(StoredAttempt.id)
            number = session.scalar(same)
            if number is None:
                new = self._insert(StoredAttempt).values(key=key, **values)
                new = new.on_conflict_do_update(index_elements=[StoredAttempt.key], set_=values)
                number = session.scalar(new.returning(StoredAttempt.id))
            return int(number)

    def _trainee_id(self, session: Session, trainee: str) -> int:
        """Return the number of a trainee, who is new or was added by somebody else this moment."""
        known = session.scalar(select(Trainee.id).where(Trainee.pseudonym == trainee))
        if known is None:
            new = self._insert(Trainee).values(pseudonym=trainee)
            new = new.on_conflict_do_update(index_elements=[Trainee.pseudonym], set_={"pseudonym": trainee})
            known = session.scalar(new.returning(Trainee.id))
        return int(known)

    def _insert(self, table: type[Trainee | StoredAttempt]) -> Any:
        return _INSERTS["sqlite" if self._database.is_sqlite else "postgresql"](table)

    def enrol(self, trainee: str) -> None:
        """Make a trainee known who has no attempt yet."""
        _look_at_pseudonym(trainee)
        with self._database.writing() as session:
            self._trainee_id(session, trainee)

    def trainees(self) -> list[str]:
        """Return all pseudonyms."""
        with self._database.reading() as session:
            return list(session.scalars(select(Trainee.pseudonym).order_by(Trainee.pseudonym)))

    def note(self, kind: str, by: str, data: object, *, trainee: str = "", attempt: int | None = None) -> None:
        """Keep what somebody says of an attempt, or of a trainee. Raises StoreError if there is none."""
        with self._database.writing() as session:
            if attempt is not None:
                owner = session.scalar(select(StoredAttempt.trainee_id).where(StoredAttempt.id == attempt))
                if owner is None:
                    raise UnknownError(f"there is no attempt {attempt}")
            else:
                owner = number_of(session, trainee)
            text = msgspec.json.encode(data).decode()
            session.add(
                Note(trainee_id=owner, attempt_id=attempt, kind=kind, by=by[:64], at_ns=time.time_ns(), data=text)
            )

    def notes(self, *, kind: str | None = None, trainee: str | None = None, attempt: int | None = None) -> list[Said]:
        """Return what was said, oldest first."""
        query = select(Note.attempt_id, Trainee.pseudonym, Note.kind, Note.by, Note.at_ns, Note.data)
        query = query.join(Trainee, Trainee.id == Note.trainee_id).order_by(Note.id)
        for column, value in ((Note.kind, kind), (Trainee.pseudonym, trainee), (Note.attempt_id, attempt)):
            query = query if value is None else query.where(column == value)
        with self._database.reading() as session:
            return [Said(*row[:5], msgspec.json.decode(row[5])) for row in session.execute(query)]

    def kept_of(self, found: Assessment) -> str | None:
        """Return whose an attempt is, None if it was never kept."""
        query = select(Trainee.pseudonym).join(StoredAttempt).where(StoredAttempt.key == _key(found))
        with self._database.reading() as session:
            return session.scalar(query)

    def listed(self, trainee: str | None = None, scenario: str | None = None) -> list[Listed]:
        """Return the attempts, oldest first."""
        return self._records(Listed, _of(select(*_LISTED).join(Trainee), trainee, scenario))

    def last_totals(self, trainees: Collection[str]) -> dict[str, float]:
        """Return the last score of each trainee who has one."""
        query = select(*_LISTED).join(Trainee).where(Trainee.pseudonym.in_(trainees), StoredAttempt.total.is_not(None))
        return {row.trainee: row.total for row in self._records(Listed, query) if row.total is not None}

    def assessment(self, number: int) -> tuple[Assessment, str]:
        """Return an attempt and whose it is."""
        query = select(*_WHOLE).join(Trainee).where(StoredAttempt.id == number)
        if not 0 < number <= _LARGEST_NUMBER:
            raise UnknownError(f"there is no attempt {number}")
        with self._database.reading() as session:
            row = session.execute(query).mappings().first()
        if row is None:
            raise UnknownError(f"there is no attempt {number}")
        try:
            whole = to_record(_Whole, row)
            return _unpacked(whole), whole.trainee
        except DAMAGED:
            raise StoreError(unreadable([number])) from None

    def recording(self, number: int) -> Path:
        """Return the recording that an attempt was judged by; it may not be there any more."""
        with self._database.reading() as session:
            stored = session.scalar(select(StoredAttempt.recording).where(StoredAttempt.id == number))
        return from_stored(str(stored))

    def past(self, trainee: str, scenario: str, until_ns: int) -> list[Past]:
        """Return the attempts of a trainee at a scenario up to a moment, oldest first."""
        query = _of(select(*_WHOLE).join(Trainee), trainee, scenario).where(StoredAttempt.began_ns <= until_ns)
        return [_past(found) for _, found in self._wholes(query)]

    def export(self, trainee: str | None = None) -> bytes:
        """Return everything that is known of a trainee, or of all, as JSON: also a file of reference attempts."""
        said = [
            {"trainee": row.trainee, "recording": row.recording, "counts": found.counts, **msgspec.to_builtins(found)}
            for row, found in self._all(trainee)
        ]
        return msgspec.json.format(msgspec.json.encode({"attempts": said}), indent=1) + b"\n"

    def table(self, trainee: str | None = None) -> str:
        """Return the attempts of a trainee, or of all, as CSV: a row an attempt, a column each metric."""
        rows = [
            {
                "trainee": row.trainee, "attempt_id": found.attempt_id, "scenario": found.scenario,
                "began_ns": found.began_ns, "outcome": found.outcome, "counts": int(found.counts), **found.metrics,
            }
            for row, found in self._all(trainee)
        ]  # fmt: skip
        file = io.StringIO()
        writer = csv.DictWriter(file, list(dict.fromkeys(name for row in rows for name in row)), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
        return file.getvalue()

    def kept(self, trainee: str | None = None) -> list[tuple[str, Assessment]]:
        """Return who made them and all attempts of a trainee, or of all, oldest first."""
        return [(row.trainee, found) for row, found in self._all(trainee)]

    def _all(self, trainee: str | None) -> list[tuple[_Whole, Assessment]]:
        if trainee is not None:
            with self._database.reading() as session:
                number_of(session, trainee)
        return self._wholes(_of(select(*_WHOLE).join(Trainee), trainee, None))

    def _wholes(self, query: Query) -> list[tuple[_Whole, Assessment]]:
        """Return rows with what they hold, oldest first, but those that cannot be read; it is told which."""
        found, damaged = [], []
        for row in self._records(_Whole, query):
            try:
                found.append((row, _unpacked(row)))
            except DAMAGED:
                damaged.append(row.id)
        self._tell_of(damaged)
        return found

    def _records(self, kind: type[_Record], query: Query) -> list[_Record]:
        """Return rows, oldest first, but those that are damaged; it is told which."""
        found, damaged = read_rows(self._database, kind, query)
        self._tell_of(damaged)
        return found

    def _tell_of(self, damaged: Sequence[int]) -> None:
        if damaged:
            self._tell(unreadable(damaged))

    def plan_erasure(self, trainee: str) -> Plan:
        """Return what `erase_with_recordings` would do."""
        with self._database.reading() as session:
            return plan_erasure(session, trainee)

    def erase(self, trainee: str) -> Sequence[Path]:
        """Forget a trainee and all attempts; return the recordings that are left.

        Beyond recovery from a file of SQLite; PostgreSQL overwrites what is deleted when it vacuums.
        """
        plan, _ = erase_rows(self._database, trainee, lambda _: ())
        return [*plan.own, *plan.shared]

    def erase_with_recordings(self, trainee: str) -> Erased:
        """Remove the recordings of a trainee, and then forget the attempts in those that are gone.

        Recordings that hold attempts of others, too, stay as they are. Attempts whose recordings could not be removed
        stay, for a second try.
        """
        removed: dict[Path, int] = {}
        failed: dict[Path, str] = {}

        def take(plan: Plan) -> Collection[Path]:
            for path in plan.own:
                try:
                    removed[path] = remove(path)
                except OSError as error:
                    failed[path] = reason_of(error)
            return failed

        plan, gone = erase_rows(self._database, trainee, take)
        return Erased(
            trainee=trainee, attempts=gone, left=plan.attempts - gone, removed=removed, shared=plan.shared,
            missing=plan.missing, failed=failed,
        )  # fmt: skip


def _of(query: Query, trainee: str | None, scenario: str | None) -> Query:
    if trainee is not None:
        query = query.where(Trainee.pseudonym == trainee)
    return query if scenario is None else query.where(StoredAttempt.scenario == scenario)


def _key(found: Assessment) -> str:
    """Return what an attempt is known by, however often it is judged."""
    return hashlib.sha256(f"{found.source}\0{found.attempt_id}\0{found.began_ns}".encode()).hexdigest()


def _values(found: Assessment, recording: Path) -> dict[str, Any]:
    score = found.score
    return {
        "recording": to_stored(recording),
        "scenario": found.scenario,
        "began_ns": found.began_ns,
        "outcome": found.outcome,
        "counts": found.counts,
        "time_s": found.time_s,
        "errors": len(found.errors),
        "critical": sum(error.severity == "critical" for error in found.errors),
        "total": score.total if score else None,
        "percent": score.percent if score else None,
        "assessment": zlib.compress(msgspec.json.encode(found)),
    }


def _unpacked(row: _Whole) -> Assessment:
    return msgspec.json.decode(zlib.decompress(row.assessment), type=Assessment)


def _past(found: Assessment) -> Past:
    return Past(
        began_ns=found.began_ns,
        outcome=found.outcome,
        counts=found.counts,
        time_s=found.time_s,
        total=found.score.total if found.score else None,
        errors=len(found.errors),
        metrics=found.metrics,
    )
