"""Collision detection: closest points of pieces of bodies and the deforming wall, and of capsules with each other.

`placed_wall` computes the positions of requested wall nodes. `clusters` and `candidate_list` (broad phase) list for
each piece the triangles that it may touch soon; `candidates` (narrow phase) measures those that are near;
`wall_candidates` combines all of this for a duct. `capsules` detects contacts of tools and catheter with the catheter;
`pairs` holds the resulting contact pairs.
"""
