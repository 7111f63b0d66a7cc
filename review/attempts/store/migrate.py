"""Tables brought to the present version: once, by one thread of one process, and nothing of a migration that broke."""

from __future__ import annotations

import threading
from functools import cache
from pathlib import Path

from alembic import command
from alembic.config import Config
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Connection, inspect

from trocar.review.attempts.store.database import Database, StoreError
from trocar.review.attempts.store.tables import Base

_VERSIONS = "alembic_version"
#: Alembic keeps the migration that runs in names of its modules, which all threads of a process share.
_one_thread = threading.Lock()


def migrate(database: Database) -> None:
    """Bring the tables of a database to the present version; one that is there already is only looked at.

    Raises StoreError: the tables are of a newer version, or of another program.
    """
    with database.reading() as session:
        if _is_present(session.connection(), database):
            return
    with _one_thread, database.writing(alone=True) as session:
        connection = session.connection()
        if not _is_present(connection, database):  # somebody else may have been first
            _refuse_foreign(connection, database)
            config = _config()
            config.attributes["connection"] = connection
            command.upgrade(config, "head")


def _is_present(connection: Connection, database: Database) -> bool:
    """Return whether the tables are of the present version. Raises StoreError if they are of a newer one."""
    found, known = MigrationContext.configure(connection).get_current_heads(), _known_versions()
    unknown = [version for version in found if version not in known]
    if unknown:
        raise StoreError(
            f"{database.name}: its tables are of version {', '.join(map(repr, unknown))}, which a newer Trocar wrote; "
            f"this one knows them up to {known[0]!r}: install the newer one, or name another with --database"
        )
    return found == known[:1]


def _refuse_foreign(connection: Connection, database: Database) -> None:
    """Refuse tables of another program where there are none of ours; in PostgreSQL only those that ours are called."""
    if MigrationContext.configure(connection).get_current_heads():
        return
    there = set(inspect(connection).get_table_names()) - {_VERSIONS}
    others = there if database.is_sqlite else there & Base.metadata.tables.keys()
    if others:
        names = ", ".join(sorted(others)[:3])
        raise StoreError(f"{database.name}: is no database of attempts, but has tables of another program: {names}")


@cache
def _known_versions() -> tuple[str, ...]:
    """Return the versions of the tables, newest first."""
    return tuple(script.revision for script in ScriptDirectory.from_config(_config()).walk_revisions())


def _config() -> Config:
    config = Config()
    config.set_main_option("script_location", str(Path(__file__).with_name("migrations")).replace("%", "%%"))
    return config
