"""How far the start of a process is, as one fraction that never falls and ends at 1."""

from __future__ import annotations

from collections.abc import Callable, Mapping

Say = Callable[[str, float], None]


def ignore(stage: str, fraction: float) -> None:
    """Take the progress of a part, and tell nobody."""


class StartProgress:
    """Joins the progress of the parts of a start.

    Args:
        parts: What share of the time of a first start each part takes, in the order in which they come.
        say: Takes what is done now, and how far the whole start is, 0 to 1.
    """

    def __init__(self, parts: Mapping[str, float], say: Say) -> None:
        self._ends = dict[str, tuple[float, float]]()
        before, whole = 0.0, sum(parts.values())
        for name, share in parts.items():
            self._ends[name] = before / whole, (before + share) / whole
            before += share
        self._say, self._so_far = say, 0.0

    def part(self, name: str) -> Say:
        """Return what takes the progress of one part, 0 to 1: stages of it may begin at 0 again."""
        begin, end = self._ends[name]

        def say(stage: str, fraction: float) -> None:
            self._so_far = max(self._so_far, begin + (end - begin) * min(max(fraction, 0.0), 1.0))
            self._say(stage, self._so_far)

        return say

    def stage(self, name: str, fraction: float) -> None:
        """Take the progress of a stage that is called as a part is; of any other it is told that it goes on."""
        if name in self._ends:
            self.part(name)(name, fraction)
        else:
            self._say(name, self._so_far)

    def finish(self, stage: str) -> None:
        """Say that everything is done."""
        self._so_far = 1.0
        self._say(stage, 1.0)
