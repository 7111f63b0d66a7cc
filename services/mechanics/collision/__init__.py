"""Collision detection: closest pairs of pieces of bodies with the deforming wall, and of capsules with each other.

`placed_wall` places the nodes of the wall that are asked for, `clusters` and `candidate_list` keep for each piece the
triangles that it may touch soon, `candidates` measures those that are near, and `wall_candidates` does all of it for a
duct. `capsules` finds segments of tools and catheter against the catheter; `pairs` is what comes out.
"""
