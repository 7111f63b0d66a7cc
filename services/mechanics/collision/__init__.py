"""Collision detection: the catheter and both forceps against the deforming duct and against each other.

Broad phase: an AABB tree of the undeformed wall (`aabb_tree`), whose boxes grow by what the wall may have moved
(`motion_bounds`, `tick`, `aabb_distance`). Narrow phase: closest points (`primitives`) on triangles whose nodes are
placed on demand (`nodes`), and the side of the wall they are on (`sides`). `search` joins both; `probes`, `rim`,
`inside` and `capsules` remember what they found from tick to tick; `pairs` is what comes out.
"""

from services.mechanics.collision.catheter import CatheterContactDetector
from services.mechanics.collision.self_contact import SelfContactDetector
from services.mechanics.collision.surface import CollisionSurface
from services.mechanics.collision.tools import ToolContactDetector

__all__ = ["CatheterContactDetector", "CollisionSurface", "SelfContactDetector", "ToolContactDetector"]
