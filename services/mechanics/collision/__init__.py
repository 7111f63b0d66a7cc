"""Collision detection: closest pairs of pieces of bodies with the deforming wall, and of capsules with each other.

`placed_wall` computes the positions of requested wall nodes. `clusters` and `candidate_list` list for each piece the
triangles that it may touch soon; `candidates` measures the near ones; `wall_candidates` does all of this for a duct.
`capsules` detects segments of tools and catheter against the catheter; `pairs` holds the resulting contact pairs.
"""
