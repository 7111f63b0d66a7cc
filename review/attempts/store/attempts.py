"""Attempts in a database: added, listed, exported and erased."""

from __future__ import annotations

import csv
import hashlib
import io
import os
import re
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import msgspec
from alembic import command
from alembic.config import Config
from sqlalchemy import Engine, create_engine, delete, event, make_url, select, text
from sqlalchemy.exc import ArgumentError, DBAPIError, NoSuchModuleError
from sqlalchemy.orm import Session

from trocar.review.attempts.assessment import Assessment
from trocar.review.attempts.report import Past
from trocar.review.attempts.store.tables import StoredAttempt, Trainee
from trocar.services.exit_codes import ExitCode
from trocar.services.runtime.errors import MissingPackageError, UserError

ENVIRONMENT = "TROCAR_ATTEMPTS"
#: Any number, of the lock that is held while tables are made.
_MIGRATING = 32
_PSEUDONYM = re.compile(r"[a-z0-9][a-z0-9._-]{0,63}", re.IGNORECASE)
_LISTED = (
    StoredAttempt.id, Trainee.pseudonym, StoredAttempt.scenario, StoredAttempt.began_ns, StoredAttempt.outcome,
    StoredAttempt.counts, StoredAttempt.time_s, StoredAttempt.total, StoredAttempt.percent, StoredAttempt.errors,
    StoredAttempt.critical, StoredAttempt.recording,
)  # fmt: skip


class StoreError(UserError):
    """A database that cannot be used, or something that is not in it."""


class UnknownError(StoreError):
    """What was named is not there, or no database can be where it was named."""

    exit_code = ExitCode.USAGE


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


def default_url() -> str:
    """Return where attempts are kept: ``$TROCAR_ATTEMPTS``, else a file of this user."""
    data = Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local/share") / "trocar"
    return os.environ.get(ENVIRONMENT) or f"sqlite:///{data / 'attempts.sqlite'}"


class Store:
    """A database of attempts, brought to the present tables when it is opened.

    Raises StoreError: one sentence, without the password, if the database cannot be used.
    """

    def __init__(self, url: str | None = None) -> None:
        self._engine = _engine(url or default_url())
        with self._refusing():
            _migrate(self._engine)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._engine.dispose()

    def add(self, found: Assessment, trainee: str, recording: Path) -> int:
        """Keep an attempt, in the place of an earlier judgement of the same one; return its number."""
        if not _PSEUDONYM.fullmatch(trainee):
            raise UnknownError(f"{trainee!r} is no pseudonym: letters, digits, '.', '_' and '-', at most 64")
        key = hashlib.sha256(f"{found.source}\0{found.attempt_id}\0{found.began_ns}".encode()).hexdigest()
        with self._session() as session:
            owner = session.scalar(select(Trainee).where(Trainee.pseudonym == trainee)) or Trainee(pseudonym=trainee)
            session.add(owner)
            session.flush()
            row = session.scalar(select(StoredAttempt).where(StoredAttempt.key == key)) or StoredAttempt(key=key)
            row.trainee_id, row.recording = owner.id, str(recording.resolve())
            row.scenario, row.began_ns, row.outcome, row.counts = (
                found.scenario, found.began_ns, found.outcome, found.counts,
            )  # fmt: skip
            row.time_s, row.errors = found.time_s, len(found.errors)
            row.critical = sum(error.severity == "critical" for error in found.errors)
            row.total, row.percent = (found.score.total, found.score.percent) if found.score else (None, None)
            row.assessment = zlib.compress(msgspec.json.encode(found))
            session.add(row)
            session.commit()
            return row.id

    def listed(self, trainee: str | None = None, scenario: str | None = None) -> list[Listed]:
        """Return the attempts, oldest first."""
        query = select(*_LISTED).join(Trainee).order_by(StoredAttempt.began_ns, StoredAttempt.id)
        if trainee is not None:
            query = query.where(Trainee.pseudonym == trainee)
        if scenario is not None:
            query = query.where(StoredAttempt.scenario == scenario)
        with self._session() as session:
            return [Listed(*values) for values in map(tuple, session.execute(query))]

    def assessment(self, number: int) -> tuple[Assessment, str]:
        """Return an attempt and whose it is."""
        query = select(StoredAttempt.assessment, Trainee.pseudonym).join(Trainee).where(StoredAttempt.id == number)
        with self._session() as session:
            row = session.execute(query).first()
        if row is None:
            raise UnknownError(f"there is no attempt {number}")
        return _unpacked(row[0]), row[1]

    def past(self, trainee: str, scenario: str, until_ns: int) -> list[Past]:
        """Return the attempts of a trainee at a scenario up to a moment, oldest first."""
        query = (
            select(StoredAttempt.assessment)
            .join(Trainee)
            .where(Trainee.pseudonym == trainee, StoredAttempt.scenario == scenario, StoredAttempt.began_ns <= until_ns)
            .order_by(StoredAttempt.began_ns, StoredAttempt.id)
        )
        with self._session() as session:
            return [_past(_unpacked(data)) for data in session.scalars(query)]

    def export(self, trainee: str | None = None) -> bytes:
        """Return everything that is known of a trainee, or of all, as JSON: also a file of reference attempts."""
        said = [
            {"trainee": name, "recording": recording, "counts": found.counts, **msgspec.to_builtins(found)}
            for name, recording, found in self._all(trainee)
        ]
        return msgspec.json.format(msgspec.json.encode({"attempts": said}), indent=1) + b"\n"

    def table(self, trainee: str | None = None) -> str:
        """Return the attempts of a trainee, or of all, as CSV: a row an attempt, a column each metric."""
        rows = [
            {
                "trainee": name, "attempt_id": found.attempt_id, "scenario": found.scenario, "began_ns": found.began_ns,
                "outcome": found.outcome, "counts": int(found.counts), **found.metrics,
            }
            for name, _, found in self._all(trainee)
        ]  # fmt: skip
        file = io.StringIO()
        writer = csv.DictWriter(file, list(dict.fromkeys(name for row in rows for name in row)), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
        return file.getvalue()

    def _all(self, trainee: str | None) -> list[tuple[str, str, Assessment]]:
        query = select(Trainee.pseudonym, StoredAttempt.recording, StoredAttempt.assessment).join(Trainee)
        if trainee is not None:
            query = query.where(Trainee.pseudonym == trainee)
        with self._session() as session:
            rows = session.execute(query.order_by(StoredAttempt.began_ns, StoredAttempt.id)).all()
        if trainee is not None and not rows:
            raise UnknownError(f"there is no trainee {trainee!r}")
        return [(name, recording, _unpacked(data)) for name, recording, data in rows]

    def erase(self, trainee: str) -> Sequence[Path]:
        """Forget a trainee and all attempts; return the recordings that are left.

        Beyond recovery from a file of SQLite; PostgreSQL overwrites what is deleted when it vacuums.
        """
        with self._session() as session:
            owner = session.scalar(select(Trainee).where(Trainee.pseudonym == trainee))
            if owner is None:
                raise UnknownError(f"there is no trainee {trainee!r}")
            mine = StoredAttempt.trainee_id == owner.id
            left = [Path(each) for each in session.scalars(select(StoredAttempt.recording).where(mine).distinct())]
            session.execute(delete(StoredAttempt).where(mine))
            session.delete(owner)
            session.commit()
        return [path for path in left if path.exists()]

    @contextmanager
    def _session(self) -> Iterator[Session]:
        with self._refusing(), Session(self._engine) as session:
            yield session

    @contextmanager
    def _refusing(self) -> Iterator[None]:
        try:
            yield
        except DBAPIError as error:
            where = self._engine.url.render_as_string(hide_password=True)
            raise StoreError(f"{where}: {str(error.orig).splitlines()[0]}") from None


def _engine(url: str) -> Engine:
    try:
        parsed = make_url(url if "://" in url else f"sqlite:///{url}")
        if parsed.get_backend_name() == "sqlite" and parsed.database:
            _make_folder(Path(parsed.database).parent)
        engine = create_engine(parsed)
    except (ArgumentError, NoSuchModuleError):
        raise UnknownError(
            "the address of the database cannot be read: sqlite:///FILE or postgresql+psycopg://..."
        ) from None
    except ModuleNotFoundError as error:
        raise MissingPackageError("the database", error.name) from None
    if parsed.get_backend_name() == "sqlite":
        event.listen(engine, "connect", _settle_sqlite)
    return engine


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    except OSError as error:
        raise UnknownError(f"{folder}: {(error.strerror or str(error)).lower()}") from None


def _settle_sqlite(connection: Any, _: object) -> None:
    """Hold foreign keys, overwrite what is deleted, and wait for another process that writes."""
    for pragma in ("foreign_keys = ON", "secure_delete = ON", "busy_timeout = 10000"):
        connection.execute(f"PRAGMA {pragma}")


def _migrate(engine: Engine) -> None:
    config = Config()
    config.set_main_option("script_location", str(Path(__file__).with_name("migrations")))
    with engine.begin() as connection:
        if connection.dialect.name == "postgresql":  # two rigs of a centre that start at once
            connection.execute(text(f"SELECT pg_advisory_xact_lock({_MIGRATING})"))
        config.attributes["connection"] = connection
        command.upgrade(config, "head")


def _unpacked(data: bytes) -> Assessment:
    return msgspec.json.decode(zlib.decompress(data), type=Assessment)


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
