"""Where errors are computed: processes of this machine, or a Dask cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from typing import Any, Protocol

from trocar.studies.pool import open_pool

Call = tuple[Any, ...]
CONNECT_S = 10.0
"""A scheduler that does not answer for so long is not there."""


class Workers(Protocol):
    """Runs functions somewhere."""

    def run(self, function: Callable[..., Any], calls: Sequence[Call]) -> Iterator[tuple[int, Any]]:
        """Yield the number of a call and its result, as they come."""


class _Here:
    """One after the other in this process."""

    def run(self, function: Callable[..., Any], calls: Sequence[Call]) -> Iterator[tuple[int, Any]]:
        for number, call in enumerate(calls):
            yield number, function(*call)


class _Pool:
    """Processes of this machine."""

    def __init__(self, pool: ProcessPoolExecutor) -> None:
        self._pool = pool

    def run(self, function: Callable[..., Any], calls: Sequence[Call]) -> Iterator[tuple[int, Any]]:
        numbers = {self._pool.submit(function, *call): number for number, call in enumerate(calls)}
        for done in as_completed(numbers):
            yield numbers[done], done.result()


class _Cluster:
    """Workers of a Dask cluster; each has to have this package and a cache of its own or a shared one."""

    def __init__(self, client: Any) -> None:
        self._client = client

    def run(self, function: Callable[..., Any], calls: Sequence[Call]) -> Iterator[tuple[int, Any]]:
        from distributed import as_completed as as_completed_there

        submitted = [self._client.submit(function, *call, pure=False) for call in calls]
        numbers = {future.key: number for number, future in enumerate(submitted)}
        for done in as_completed_there(submitted):
            yield numbers[done.key], done.result()


def connect_client(scheduler: str) -> Any:
    """Return a client of a Dask scheduler. Raises ConnectionError if none answers at that address."""
    from distributed import Client

    try:
        return Client(scheduler, timeout=CONNECT_S)
    except (OSError, ValueError) as error:
        raise ConnectionError(f"no Dask scheduler answers at {scheduler}: {error}") from error


@contextmanager
def open_workers(jobs: int, scheduler: str | None) -> Iterator[Workers]:
    """Open ``jobs`` processes here, or connect to the scheduler of a cluster.

    Raises ConnectionError if there is no scheduler at that address.
    """
    if scheduler is not None:
        client = connect_client(scheduler)
        with client, client.as_current():
            yield _Cluster(client)
    elif jobs == 1:
        yield _Here()
    else:
        with open_pool(jobs) as pool:
            yield _Pool(pool)
