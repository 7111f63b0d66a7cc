"""What each file of tests took when it was last run here: the longest begin first the next time.

The last file of all would else keep one worker while the others have nothing left.
"""

from __future__ import annotations

import json
import os
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from xml.etree import ElementTree

from trocar.services.files.atomic_file import atomic_file
from trocar.services.files.cache_directory import cache_directory, make_folders

#: Names a copy of what is kept, of one run alone: all its workers have to read the same.
COPY = "TROCAR_TESTS_SECONDS"
_KEPT = "test-seconds.json"
_TOLD = 12  # as many as fit a few lines


def dotted_name(node_id: str) -> str:
    """Return the name of a test's file as reports of pytest have it."""
    return node_id.partition(".py")[0].replace("/", ".")


def seconds_of(report: Path) -> dict[str, float]:
    """Return what the tests of each file took, by its dotted name, from a report in JUnit's format."""
    seconds: dict[str, float] = defaultdict(float)
    for case in ElementTree.parse(report).iter("testcase"):
        seconds[case.get("classname", "")] += float(case.get("time", 0.0))
    return dict(seconds)


def of_last_run() -> dict[str, float]:
    """Return the seconds of all files that were ever run here, of each the last; none where nobody can say."""
    path = Path(os.environ.get(COPY) or cache_directory() / _KEPT)
    try:
        seconds: dict[str, float] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return seconds


def keep_seconds(seconds: dict[str, float]) -> None:
    """Remember what files took."""
    make_folders(cache_directory())
    with atomic_file(cache_directory() / _KEPT) as half:
        half.write_text(json.dumps({**of_last_run(), **seconds}), encoding="utf-8")


def longest(seconds: dict[str, float]) -> str:
    """Return a line of the files that took longest."""
    most: Iterable[tuple[str, float]] = sorted(seconds.items(), key=lambda each: -each[1])[:_TOLD]
    return "longest files: " + ", ".join(f"{name.removeprefix('tests.')} {took:.0f} s" for name, took in most)
