"""A server of PostgreSQL for tests: the programs of the Debian package, a cluster of its own behind a socket."""

from __future__ import annotations

import os
import pwd
import secrets
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import psycopg

from tests.patience import PATIENCE_S

#: Nothing has to outlive the tests.
_SETTINGS = ("listen_addresses=", "fsync=off", "full_page_writes=off", "max_connections=20", "shared_buffers=16MB")


def programs() -> Path | None:
    """Return the folder of the newest server that is installed, None where none is."""
    found = [path.parent for path in Path("/usr/lib/postgresql").glob("*/bin/postgres")]
    return max(found, key=lambda path: int(path.parent.name), default=None)


@contextmanager
def server(folder: Path) -> Iterator[Callable[[], str]]:
    """Run a server; yields what makes an empty database and returns its address."""
    who = {}
    if os.geteuid() == 0:  # which it refuses to run as
        user = pwd.getpwnam("postgres")
        os.chown(folder, user.pw_uid, user.pw_gid)
        who = {"user": user.pw_uid, "group": user.pw_gid, "extra_groups": []}
    data, bin_folder = folder / "data", programs()
    assert bin_folder is not None
    make = [bin_folder / "initdb", "-D", data, "-U", "trocar", "-A", "trust", "-E", "UTF8", "--locale=C", "--no-sync"]
    subprocess.run(make, check=True, capture_output=True, cwd=folder, **who)
    settings = [word for each in (*_SETTINGS, f"unix_socket_directories={folder}") for word in ("-c", each)]
    process = subprocess.Popen(
        [bin_folder / "postgres", "-D", data, *settings], cwd=folder, stderr=subprocess.DEVNULL, **who
    )
    try:
        _wait(process, folder)
        yield lambda: _database(folder)
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(PATIENCE_S)


def _connect(folder: Path) -> psycopg.Connection:
    return psycopg.connect(host=str(folder), user="trocar", dbname="postgres", autocommit=True)


def _wait(process: subprocess.Popen[bytes], folder: Path) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while True:
        assert process.poll() is None, "the server has ended"
        try:
            _connect(folder).close()
        except psycopg.OperationalError:
            assert time.monotonic() < end_s, "the server does not answer"
            time.sleep(0.1)
        else:
            return


def _database(folder: Path) -> str:
    name = f"t{secrets.token_hex(6)}"
    with _connect(folder) as connection:
        connection.execute(f"CREATE DATABASE {name}".encode())
    return f"postgresql+psycopg://trocar@/{name}?host={folder}"


@contextmanager
def short_folder() -> Iterator[Path]:
    """Yield a new folder: the path of a socket is a hundred characters at most, and others may look in."""
    folder = Path(tempfile.mkdtemp(prefix="trocar-pg-"))
    try:
        yield folder
    finally:
        shutil.rmtree(folder)
