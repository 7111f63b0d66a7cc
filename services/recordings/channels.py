"""Names of bus topics in a file."""

from __future__ import annotations


def channel_name(topic: str) -> str:
    """Return the name of a bus topic in a file, a path for viewers."""
    return f"/{topic.replace('.', '/')}"
