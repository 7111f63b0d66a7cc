"""Islands: contacts that W couples, directly or through others. What one island does is nothing to the others.

A forceps that holds the duct and one that holds the catheter are two islands until the catheter touches the wall. While
one hand moves, the contacts of the other are solved by the first sweep; a Newton step, which grows with the cube of its
unknowns, is taken for the islands that are not.
"""

from __future__ import annotations

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.contact.problem import ContactProblem
from trocar.services.mechanics.contact.sweeps import is_solved


@kernel
def find_islands(problem: ContactProblem, W: FloatArray) -> None:
    """Write the first contact of the island of each contact."""
    island = problem.island
    for block in range(problem.rows.n_contacts):
        island[block] = block
        for other in range(block):
            if island[other] != island[block] and _are_coupled(W, block, other):
                _join(island[: block + 1], island[block], island[other])


@kernel
def _are_coupled(W: FloatArray, block: int, other: int) -> bool:
    for row in range(3 * block, 3 * block + 3):
        for column in range(3 * other, 3 * other + 3):
            if W[row, column] != 0.0:
                return True
    return False


@kernel
def _join(island: IntArray, one: int, other: int) -> None:
    """Make two islands one, named by its first contact."""
    for block in range(island.shape[0]):
        if island[block] == one or island[block] == other:
            island[block] = min(one, other)


@kernel
def note_settled(problem: ContactProblem, tolerance_n: float) -> None:
    """Note the contacts of islands of which the last sweep is the solution (`sweeps.is_solved`).

    An island of one contact is not worth leaving out.
    """
    island, is_settled, k = problem.island, problem.is_settled, problem.rows.n_contacts
    is_settled[:k] = False
    for block in range(k):
        if island[block] != block:
            is_settled[island[block]] = True
    for block in range(k):
        if not is_solved(problem, block, tolerance_n):
            is_settled[island[block]] = False
    for block in range(k):
        is_settled[block] = is_settled[island[block]]
