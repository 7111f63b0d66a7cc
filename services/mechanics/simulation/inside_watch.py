"""Telling of tools that are inside a wall or the catheter, where they have no contact (`contact.engagement`)."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence


class ToolInsideWarning(UserWarning):
    """A tool is inside a body and passes through it without force until it is clear of it."""


def warn(sentence: str) -> None:
    """Warn the caller of `Simulation.step`."""
    warnings.warn(sentence, ToolInsideWarning, stacklevel=4)


class InsideWatch:
    """Tells once of each tool that stays inside a body, and again after it has been clear.

    Attributes:
        tell: callable. Called with one sentence; by default it warns.
        inside: (tools,) bool. Which tools were inside at the end of the last tick.
    """

    def __init__(self, n_tools: int) -> None:
        self.tell: Callable[[str], None] = warn
        self.inside = [False] * n_tools

    def look(self, present: Sequence[bool], disengaged: Sequence[bool]) -> None:
        """Compare with the last tick."""
        if True not in disengaged and True not in self.inside:  # as nearly always
            return
        now = [there and waits for there, waits in zip(present, disengaged, strict=True)]
        before, self.inside = self.inside, now
        for tool, (was, is_) in enumerate(zip(before, now, strict=True)):
            if is_ and not was:
                self.tell(
                    f"tool {tool} is inside the wall or the catheter: it has no contact and no force until it has been "
                    "clear of them (tools.disengaged)"
                )
