"""How far a hand may have moved an arm between two readings."""

from __future__ import annotations

#: Speed that no hand has. A place that stays is believed once it is within reach, and trips the velocity limit then.
REACH_M_S = 20.0
#: No arm of a trainer reaches further from the middle of its workspace.
FURTHEST_M = 1.0
