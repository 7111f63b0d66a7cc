"""What a rig that runs on may not do: hold more and more memory, or miss more and more deadlines."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from scipy import stats

ROOT = Path(__file__).parents[2]
MINUTES = 60
#: Growth is judged from then on: until then a process still fills what it keeps.
SETTLED = 10
#: A rig may stay on for a month of 30 days.
MONTH_H = 720.0
#: Misses of the second half that chance alone would bring this rarely are more misses.
RARE = 0.001

Minutes = Sequence[Mapping[str, float]]


def judge(minutes: Minutes) -> list[str]:
    """Return what is not flat: in a run that is not yet whole only what is sure already."""
    is_whole = len(minutes) >= MINUTES
    why = []
    for name, held in series(minutes, " MB") if len(minutes) >= SETTLED else ():
        (low, high), most = growth(held), most_mb_h(held[0])
        if (high if is_whole else low) > most:
            why.append(f"{name} grows by {low:.1f} to {high:.1f} MB an hour, at most {most:.1f} are allowed")
    for name, misses in series(minutes, " misses") if is_whole else ():
        if chance_of(misses) < RARE:
            why.append(f"{name} misses more deadlines in the second half than in the first")
    return why


def series(minutes: Minutes, unit: str) -> Iterator[tuple[str, list[float]]]:
    """Yield the names of what is measured in this unit, with what was measured in each minute."""
    for name in [each for each in minutes[0] if each.endswith(unit)] if minutes else ():
        yield name.removesuffix(unit), [each[name] for each in minutes]


def most_mb_h(held_mb: float) -> float:
    """Return by how much an hour a process may grow: in a month it fills the rest of its container's memory.

    The container's files under /tmp are in the same memory.
    """
    text = (ROOT / "docker-compose.yml").read_text(encoding="utf-8")
    memory, files = (
        float(found[1]) * 1024.0 ** {"m": 2, "g": 3}[found[2]] * 1e-6
        for name in ("PROCESS_MEMORY", "TMP_SIZE")
        if (found := re.search(rf"\{{{name}:-(\d+)([mg])\}}", text))
    )
    return (memory - files - held_mb) / MONTH_H


def growth(held: Sequence[float]) -> tuple[float, float]:
    """Return by how much an hour what is read each minute grows: an interval of 95 % of the line's slope."""
    line = stats.linregress(range(len(held)), held)
    half = float(stats.t.ppf(0.975, len(held) - 2)) * line.stderr if len(held) > 2 else math.inf
    return 60.0 * (line.slope - half), 60.0 * (line.slope + half)


def chance_of(misses: Sequence[float]) -> float:
    """Return how often chance alone makes the second half so much worse than the first.

    Misses come in bursts, so minutes are compared and not ticks: by their ranks (Mann and Whitney, Ann. Math. Stat. 18
    (1947) 50).
    """
    half = len(misses) // 2
    if max(misses) == min(misses):
        return 1.0
    return float(stats.mannwhitneyu(misses[half:], misses[:half], alternative="greater").pvalue)
