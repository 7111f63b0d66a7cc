"""Which segment of a volume a person means."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from trocar.services.meshes.errors import MeshError
from trocar.services.messages.nearest_word import did_you_mean

MOST_SAID = 12


def choose_label(path: Path, wanted: str | None, segments: Mapping[tuple[int, int], str]) -> tuple[int, int]:
    """Return layer and value of the segment with that number or name; the only one where none is said.

    Raises MeshError if there is none, or more than one; the sentence names the file and its segments.
    """
    if not segments:
        raise MeshError(f"{path}: holds no label: all its voxels are 0")
    if wanted is None:
        if len(segments) > 1:
            raise MeshError(f"{path}: say which label is the duct's, it has {listed(segments)}")
        return next(iter(segments))
    found = [key for key, name in segments.items() if name == wanted] or [
        key for key, name in segments.items() if str(key[1]) == wanted or name.lower() == wanted.lower()
    ]
    if len(found) > 1:
        raise MeshError(f"{path}: label '{wanted}' is there {len(found)} times: {listed(segments)}")
    if not found:
        near = did_you_mean(wanted, [name for name in segments.values() if name])
        raise MeshError(f"{path}: has no label '{wanted}'; it has {listed(segments)}{near}")
    return found[0]


def listed(segments: Mapping[tuple[int, int], str]) -> str:
    """Return the segments as words of a sentence."""
    said = [f"{value} ({name})" if name else str(value) for (_, value), name in segments.items()]
    more = f" and {len(said) - MOST_SAID} more" if len(said) > MOST_SAID else ""
    return ", ".join(said[:MOST_SAID]) + more
