"""Keys of rig files that were removed: a file that names one is read, and one sentence says that it does nothing."""

from __future__ import annotations

import logging
import os
from typing import Any

#: By the path of a removed key: what holds instead.
REMOVED_RIG_KEYS = {
    "rungs": "a loop takes SCHED_FIFO or, where that is refused, niceness -20",
    "supervisor.watch_floor": "`trocar latency` watches the machine while it looks",
}
#: Paths that this process or its parent has already warned of, separated by spaces: a rig has many processes.
_TOLD = "TROCAR_REMOVED_KEYS_TOLD"


def drop_removed_keys(data: dict[str, Any], where: str) -> None:
    """Take removed keys out of the content of a rig file, and warn of each once."""
    for path, instead in REMOVED_RIG_KEYS.items():
        *parents, last = path.split(".")
        mapping: Any = data
        for parent in parents:
            mapping = mapping.get(parent) if isinstance(mapping, dict) else None
        if isinstance(mapping, dict) and last in mapping:
            del mapping[last]
            _warn_once(path, f"{where}: {path}: this key was removed and has no effect: {instead}")


def _warn_once(path: str, sentence: str) -> None:
    told = os.environ.get(_TOLD, "").split()
    if path not in told:
        os.environ[_TOLD] = " ".join([*told, path])
        logging.getLogger(__name__).warning(sentence)
