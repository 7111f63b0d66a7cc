"""Reading a folder of results that an earlier run of a study has left."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def read_as_ours(folder: Path) -> Iterator[None]:
    """Make what comes of reading results that we have not written, or that something has broken, one sentence.

    Raises ValueError that names the folder.
    """
    try:
        yield
    except (json.JSONDecodeError, UnicodeDecodeError, LookupError, TypeError, AttributeError) as error:
        raise ValueError(f"{folder}: order.json or results.jsonl in it is broken, or not ours ({error})") from error
