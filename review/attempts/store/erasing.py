"""Erasing a trainee: what there is, and its rows once the files are taken, also on a full disk."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from pathlib import Path

from sqlalchemy import delete, exists, select
from sqlalchemy.orm import Session

from trocar.review.attempts.store.database import Database, DiskFullError, UnknownError
from trocar.review.attempts.store.recordings import Plan, from_stored, is_there
from trocar.review.attempts.store.tables import StoredAttempt, Trainee

#: Numbers in one question: below the 999 variables that SQLite allowed until 3.32.
_AT_ONCE = 500


def erase_rows(database: Database, trainee: str, take: Callable[[Plan], Collection[Path]]) -> tuple[Plan, int]:
    """Forget what is left after `take` has taken the files but for those that it returns, also on a full disk.

    Return what there was, and how many attempts are forgotten.
    """
    plan, gone = None, []
    try:
        with database.writing(alone=True) as session:
            plan = plan_erasure(session, trainee)
            failed = take(plan)
            gone = [number for number, path in _attempts_of(session, trainee) if path not in failed]
            _delete(session, trainee, gone)
    except DiskFullError:
        if plan is None:
            raise
        with database.writing(alone=True, has_room=False) as session:
            _delete(session, trainee, gone)
    return plan, len(gone)


def _attempts_of(session: Session, trainee: str) -> list[tuple[int, Path]]:
    mine = StoredAttempt.trainee_id == number_of(session, trainee)
    rows = session.execute(select(StoredAttempt.id, StoredAttempt.recording).where(mine))
    return [(number, from_stored(str(stored))) for number, stored in rows]


def plan_erasure(session: Session, trainee: str) -> Plan:
    """Return what there is of a trainee."""
    attempts, shared = _attempts_of(session, trainee), _shared(session, trainee)
    paths = list(dict.fromkeys(path for _, path in attempts))
    return Plan(
        trainee=trainee,
        attempts=len(attempts),
        own=[path for path in paths if path not in shared and is_there(path)],
        shared={path: names for path, names in shared.items() if is_there(path)},
        missing=[path for path in paths if not is_there(path)],
    )


def _shared(session: Session, trainee: str) -> dict[Path, list[str]]:
    """Return the recordings of a trainee that hold attempts of others, too, and of whom."""
    number = number_of(session, trainee)
    mine = select(StoredAttempt.recording).where(StoredAttempt.trainee_id == number)
    query = select(StoredAttempt.recording, Trainee.pseudonym).join(Trainee).distinct()
    rows = session.execute(query.where(Trainee.id != number, StoredAttempt.recording.in_(mine)))
    shared: dict[Path, list[str]] = {}
    for stored, name in rows:
        shared.setdefault(from_stored(str(stored)), []).append(name)
    return {path: sorted(names) for path, names in shared.items()}


def _delete(session: Session, trainee: str, numbers: Sequence[int]) -> None:
    """Delete attempts of a trainee, and the trainee if there are no others."""
    owner = number_of(session, trainee)
    for first in range(0, len(numbers), _AT_ONCE):
        some = StoredAttempt.id.in_(numbers[first : first + _AT_ONCE])
        session.execute(delete(StoredAttempt).where(StoredAttempt.trainee_id == owner, some))
    has_others = exists().where(StoredAttempt.trainee_id == owner)
    session.execute(delete(Trainee).where(Trainee.id == owner, ~has_others))


def number_of(session: Session, trainee: str) -> int:
    """Return the number of a trainee's row. Raises StoreError if there is none."""
    number = session.scalar(select(Trainee.id).where(Trainee.pseudonym == trainee))
    if number is None:
        raise UnknownError(f"there is no trainee {trainee!r}")
    return number
