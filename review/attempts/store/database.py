"""A database that several processes use at once: how it is opened, and its transactions that read and that write.

Who writes is alone in SQLite (``BEGIN IMMEDIATE``) from the first statement on and waits for others, so that no
transaction that has read is refused when it comes to write. In PostgreSQL writers of attempts go side by side, and who
erases or migrates is alone, by an advisory lock. SQLite keeps its rollback journal: in its WAL mode a full disk, or a
folder that may only be read, lets nobody read either.
"""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sqlalchemy import URL, Connection, Engine, create_engine, event, make_url
from sqlalchemy.exc import ArgumentError, DBAPIError, NoSuchModuleError
from sqlalchemy.orm import Session

from trocar.services.messages.exit_codes import ExitCode
from trocar.services.runtime.errors import MissingPackageError, UserError

ENVIRONMENT = "TROCAR_ATTEMPTS"
#: How long who writes waits for others.
PATIENCE_S = 60
#: Linux sends a lost request again after 1, 3 and 7 s (RFC 6298), so that three may be lost before nobody is there.
_CONNECT_S = 10
#: Number of the lock in PostgreSQL: any one, as nobody else locks by number in this database.
_LOCK = 32
_DRIVERS = {"sqlite": {}, "postgresql": {"connect_timeout": _CONNECT_S}}


class StoreError(UserError):
    """A database that cannot be used, or something that is not in it."""


class UnknownError(StoreError):
    """What was named is not there, or no database can be where it was named."""

    exit_code = ExitCode.USAGE


class DiskFullError(StoreError):
    """SQLite found no room on the disk; nothing was changed."""


def default_url() -> str:
    """Return where attempts are kept: ``$TROCAR_ATTEMPTS``, else a file of this user."""
    data = Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local/share") / "trocar"
    return os.environ.get(ENVIRONMENT) or str(data / "attempts.sqlite")


class Database:
    """Connections to a database, and what they refuse as one sentence without the password.

    Raises StoreError if the address cannot be read, or it is a file that is not there and `create` is false.
    """

    def __init__(self, url: str, *, create: bool) -> None:
        parsed = _parsed(url)
        self.name = parsed.render_as_string(hide_password=True)
        file = _file_of(parsed)
        if file is not None:
            _look_at(file, create=create)
        self.engine = _engine(parsed)

    @property
    def is_sqlite(self) -> bool:
        """Whether it is a file of SQLite, or in memory, and not a server."""
        return self.engine.dialect.name == "sqlite"

    def close(self) -> None:
        """Close all connections."""
        self.engine.dispose()

    @contextmanager
    def reading(self) -> Iterator[Session]:
        """Yield a session that reads. Raises StoreError if the database refuses something."""
        with self.refusing(), Session(self.engine) as session:
            yield session

    @contextmanager
    def writing(self, *, alone: bool = False, has_room: bool = True) -> Iterator[Session]:
        """Yield a session that writes, committed at the end.

        Raises StoreError if the database refuses something, DiskFullError if SQLite finds no room.

        Args:
            alone: Nobody else writes meanwhile.
            has_room: False keeps SQLite's journal in memory: on a full disk rows can still be deleted, but what ends
                the process within these milliseconds damages the file.
        """
        engine = self.engine.execution_options(writes=True, alone=alone, has_room=has_room)
        with self.refusing(), Session(engine) as session, session.begin():
            yield session

    @contextmanager
    def refusing(self) -> Iterator[None]:
        """Turn what a database refuses into one sentence."""
        try:
            yield
        except DBAPIError as error:
            kind = DiskFullError if _is_disk_full(error.orig) else StoreError
            raise kind(f"{self.name}: {reason_of(error)}") from None
        except UnicodeDecodeError:  # SQLite names what it does not understand
            raise StoreError(f"{self.name}: is damaged") from None
        except UnicodeEncodeError as error:
            raise StoreError(f"{error.object!r} is no text that a database keeps") from None


def reason_of(error: DBAPIError) -> str:
    """Return what a database says, in a line."""
    lines = str(error.orig).strip().splitlines()
    return lines[0] if lines else type(error.orig).__name__


def _parsed(url: str) -> URL:
    try:
        parsed = make_url(url) if "://" in url else URL.create("sqlite", database=url)
        known = parsed.get_backend_name() in _DRIVERS
    except ArgumentError:
        known = False
    if not known:
        raise UnknownError("the address of the database cannot be read: sqlite:///FILE or postgresql+psycopg://...")
    return parsed


def _file_of(url: URL) -> Path | None:
    """Return the file of a database, None if it is a server's or in memory, or SQLite's own kind of address."""
    name = url.database or ""
    is_file = url.get_backend_name() == "sqlite" and name not in ("", ":memory:") and not name.startswith("file:")
    return Path(name) if is_file else None


def _look_at(file: Path, *, create: bool) -> None:
    try:
        is_there = file.exists()
        if create and not is_there:
            file.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    except OSError as error:
        raise UnknownError(f"{error.filename or file}: {(error.strerror or str(error)).lower()}") from None
    if not create and not is_there:
        raise UnknownError(
            f"there is no database of attempts at {file}: `trocar score FILE --trainee NAME` makes it, and --database "
            "names another"
        )


def _engine(url: URL) -> Engine:
    try:
        engine = create_engine(url, connect_args=_DRIVERS[url.get_backend_name()])
    except (ArgumentError, NoSuchModuleError):
        raise UnknownError(
            "the address of the database cannot be read: sqlite:///FILE or postgresql+psycopg://..."
        ) from None
    except ModuleNotFoundError as error:
        raise MissingPackageError("the database", error.name) from None
    if engine.dialect.name == "sqlite":
        event.listen(engine, "connect", _settle_sqlite)
        event.listen(engine, "begin", _begin_sqlite)
    else:
        event.listen(engine, "begin", _begin_postgres)
    return engine


def _settle_sqlite(connection: Any, _: object) -> None:
    """Hold foreign keys, overwrite what is deleted, wait for another process that writes, and read damaged text."""
    connection.isolation_level = None  # `_begin_sqlite` begins, so that also changes of tables can be taken back
    connection.text_factory = lambda data: data.decode("utf-8", "replace")
    for pragma in (
        "foreign_keys = ON",
        "secure_delete = ON",
        "temp_store = MEMORY",
        f"busy_timeout = {1000 * PATIENCE_S}",
    ):
        connection.execute(f"PRAGMA {pragma}")


def _begin_sqlite(connection: Connection) -> None:
    options = connection.get_execution_options()
    if options.get("writes"):
        _choose_journal(connection, has_room=options["has_room"])
        connection.exec_driver_sql("BEGIN IMMEDIATE")
    else:  # takes no lock yet, and is no question of ours
        connection.connection.driver_connection.execute("BEGIN")  # type: ignore[union-attr]


def _choose_journal(connection: Connection, *, has_room: bool) -> None:
    in_memory = connection.exec_driver_sql("PRAGMA journal_mode").scalar() == "memory"
    if in_memory == has_room:
        connection.exec_driver_sql(f"PRAGMA journal_mode = {'DELETE' if has_room else 'MEMORY'}")


def _begin_postgres(connection: Connection) -> None:
    options = connection.get_execution_options()
    if options.get("writes"):
        kind = "" if options["alone"] else "_shared"
        connection.exec_driver_sql(f"SELECT pg_advisory_xact_lock{kind}({_LOCK})")


def _is_disk_full(error: object) -> bool:
    """Return whether SQLite found no room; where files may not grow, it says that it could not write."""
    code = getattr(error, "sqlite_errorcode", None)
    return code is not None and code & 0xFF in (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR)
