"""A tool jumps in one tick, in each direction, and stays there for a while or comes back."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from trocar.studies.stability.drive import Play
from trocar.studies.stability.family import Case, Draw, played
from trocar.studies.stability.situations import LEAD_STEPS, beside, threaded

SIZES_MM = 1, 2, 5, 10, 20, 50
DIRECTIONS = {"+x": 0, "-x": 0, "+y": 1, "-y": 1, "+z": 2, "-z": 2}
SITUATIONS = {"holding": threaded, "beside": beside}
AFTER_STEPS = 150


def cases(draw: Draw) -> Iterator[Case]:
    """Every size, tool and direction, while both tools hold and while they hold nothing."""
    if not draw.is_long:
        for size, tool, direction in ((50, 1, "-z"), (10, 0, "+y")):
            yield _case("holding", size, tool, direction, False)
        return
    for situation in SITUATIONS:
        for size in SIZES_MM:
            for tool in (0, 1):
                for direction in DIRECTIONS:
                    for returns in (False, True):
                        yield _case(situation, size, tool, direction, returns)


def _case(situation: str, size_mm: int, tool: int, direction: str, returns: bool) -> Case:
    name = f"{situation}, tool {tool} by {size_mm} mm along {direction}{' and back' if returns else ''}"
    return played(name, partial(_play, situation, size_mm, tool, direction, returns))


def _play(situation: str, size_mm: int, tool: int, direction: str, returns: bool) -> Play:
    start = SITUATIONS[situation]()
    jump = np.zeros((AFTER_STEPS, 3))
    jump[:, DIRECTIONS[direction]] = 1e-3 * size_mm * (1.0 if direction[0] == "+" else -1.0)
    if returns:
        jump[AFTER_STEPS // 2 :] = 0.0
    return Play(scene=start.scene, hands=start.hands.then(AFTER_STEPS).moved(tool, jump, LEAD_STEPS), may_jump=True)
