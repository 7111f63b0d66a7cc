"""The deforming wall as the kernels of detection see it: patches of triangles on nodes that move."""

from __future__ import annotations

from typing import Annotated

from services.mechanics.arrays import ByteArray, FloatArray, IntArray, LongArray
from services.mechanics.collision.boxes import WIDTH
from services.mechanics.compiled.struct import Struct, reader

# A depth-first walk of a balanced binary tree holds one sibling a level.
MAX_DEPTH = 64
#: Numbers of a region: the translation of its middle, and of its deformation the leading shapes.
REGION_WIDTH = 3 + 8


class Regions(Struct):
    """Pieces of a straight wall whose motion since some moment can be asked for, see `regions`; c may be 0."""

    shape: Annotated[FloatArray, "c", REGION_WIDTH, "r"]  # of modal coordinates: the middle's motion, the deformation
    left: Annotated[FloatArray, "c"]  # what the shapes leave of a vertex' motion, times |omega q|
    of_node: Annotated[IntArray, "m"]  # regions of each node, side by side
    first: Annotated[IntArray, "n + 1"]
    now: Annotated[FloatArray, "c", REGION_WIDTH]  # in this tick, where the stamp is its
    stamp: Annotated[LongArray, "c"]
    changed: Annotated[FloatArray, "c"]  # how much residuals have changed since a moment, at most
    asked_of: Annotated[LongArray, "n"]  # number of the last question of that sort that a node has answered
    asked: int = 0


class Body(Struct):
    """The deformation, shared by the patches of one surface; t is n where cross-sections turn, else 0."""

    rest: Annotated[FloatArray, "n", 3]  # undeformed positions
    Phi: Annotated[FloatArray, "n", 3, "r"]  # modes; turned walls: without the sections' rigid motion
    omega: Annotated[FloatArray, "r"]  # weights of the displacement bound
    block: Annotated[IntArray, "b + 1"]  # modes side by side, each block with a bound of its own
    block_reach: Annotated[FloatArray, "b"]  # of |u| by what |omega q| a block has
    q: Annotated[FloatArray, "r"]  # modal coordinates of this tick
    anchor: Annotated[FloatArray, "r"]  # those from which the travel is counted, see `tick`
    residual: Annotated[FloatArray, "n", 3]  # displacement beyond the modes, zero but at loaded nodes
    loaded: Annotated[IntArray, "n"]  # loaded nodes, the first n_loaded count
    load_stamp: Annotated[LongArray, "n"]  # last tick in which a node was loaded
    position: Annotated[FloatArray, "n", 3]  # deformed positions, valid where the stamp is this tick's
    stamp: Annotated[LongArray, "n"]
    arm: Annotated[FloatArray, "t", 3]  # of each node from the axis
    segment: Annotated[IntArray, "t"]  # between which stations of the axis
    fraction: Annotated[FloatArray, "t"]  # how far between
    turn: Annotated[FloatArray, "s", 3]  # rotation vectors of the stations in this tick
    centre: Annotated[FloatArray, "s", 3]  # and where they are
    last_turn: Annotated[FloatArray, "s", 3]  # the same in the last tick
    last_centre: Annotated[FloatArray, "s", 3]
    rest_centre: Annotated[FloatArray, "s", 3]
    regions: Regions
    largest_reach: float  # of the wall's tree
    growth: float  # beta: see `motion_bounds`; 0 on a straight wall
    largest_arm: float = 0.0
    norm: float = 0.0  # E = |omega q|
    energy_norm: float = 0.0  # E (1 + beta E)^2, what reach and spread multiply
    largest_residual: float = 0.0
    anchor_norm: float = 0.0  # E there
    anchor_travel: float = 0.0  # energy travel up to there
    energy_travel: float = 0.0  # changes of E, grown alike; less what was noted it bounds the change since
    energy_noted: float = 0.0  # what is to be noted of it in this tick
    anchor_motion: float = 0.0  # the same of how far the modes have moved any node
    motion_travel: float = 0.0
    motion_noted: float = 0.0
    residual_travel: float = 0.0  # sum of the largest changes of a residual
    turned_shift: float = 0.0  # turned walls: how far the sections' motion has carried any node from rest
    turned_travel: float = 0.0  # and the sum of that of each tick
    travel: float = 0.0  # the same of how far any node has moved
    travel_noted: float = 0.0
    n_loaded: int = 0
    tick: int = 0
    triangle_tests: int = 0
    tree_visits: int = 0
    nodes_placed: int = 0
    searches: int = 0


class Patch(Struct):
    """Triangles to search, with topology and tree of boxes: the wall itself, the caps of its openings, or its rims."""

    triangles: Annotated[IntArray, "m", 3]
    neighbour: Annotated[IntArray, "m", 3]  # triangle across edge k -> k + 1
    ring_start: Annotated[IntArray, "n + 1"]
    ring: Annotated[IntArray, "3 m"]  # triangles round each vertex
    on_rim: Annotated[ByteArray, "n"]
    span: Annotated[IntArray, "k", 2]  # of the tree, see `aabb_tree.AabbTree`
    order: Annotated[IntArray, "m"]
    boxes: Annotated[FloatArray, "k", WIDTH]  # see `boxes`
    stack: Annotated[IntArray, MAX_DEPTH]  # nodes still to visit
    bound: Annotated[FloatArray, MAX_DEPTH]  # their distances


class Shell(Struct):
    """What a detector's kernel needs of a surface."""

    body: Body
    wall: Patch
    caps: Patch
    rims: Patch
    rim_owner: Annotated[IntArray, "e"]  # 3 * wall triangle + edge


shell_at = reader(Shell)
