"""Processes that compute for this one, and are gone when it is."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, get_context

from trocar.services.runtime.realtime.autogroup import end_with_parent


@contextmanager
def open_pool(jobs: int) -> Iterator[ProcessPoolExecutor]:
    """Open ``jobs`` processes.

    They end with this process, even if it is killed. Whoever is interrupted, or finds that one of them failed, does not
    wait for what the others are at: that is lost.
    """
    others = active_children()
    with ProcessPoolExecutor(jobs, get_context("spawn"), _begin) as pool:
        try:
            yield pool
        except BaseException:
            on_its_way = vars(pool)["_call_queue"]
            pool.shutdown(wait=False, cancel_futures=True)
            for child in active_children():
                if child not in others:
                    child.terminate()
            # Else what is being written to workers that are gone is waited for: CPython does so itself since 3.12
            # (gh-94777).
            vars(on_its_way)["_reader"].close()
            raise


def _begin() -> None:
    """Keep linear algebra to one thread as well, so that sums are taken in the same order everywhere."""
    end_with_parent()
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
