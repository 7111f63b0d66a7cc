"""The table of families, the one place that names them all: a new one is a file in this folder and a row here."""

from __future__ import annotations

from services.studies.stability.families import jerks, jumps, lost_ticks, vanishing
from services.studies.stability.family import Family

FAMILIES: dict[str, Family] = {
    "jumps": Family("a tool jumps by 1 to 50 mm in one tick", jumps.cases),
    "jerks": Family("a hand jerks by 10 to 30 mm at 0.1 to 2 m/s in a random direction", jerks.cases),
    "lost_ticks": Family("as the hands move: jitter, 20 % of the ticks lost, stalls of 5 to 250 ms", lost_ticks.cases),
    "vanishing": Family("tools that vanish and come back, holding and pressing", vanishing.cases),
}
