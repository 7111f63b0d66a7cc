"""How far a hand may have moved an arm between two readings."""

from __future__ import annotations

#: Speed that no hand at an arm has, which is beyond every velocity limit, too: a place that stays is believed once it
#: is within reach, and trips that limit then.
REACH_M_S = 20.0
#: No arm of a trainer reaches further from the middle of its workspace: a Premium 3.0, than which none is larger, is
#: 0.84 m wide.
FURTHEST_M = 1.0
