"""A few members of every family, each against every criterion that applies to it."""

import pytest

from services.studies.stability.families import FAMILIES
from services.studies.stability.family import Reach
from services.studies.stability.suite import Order, list_cases, run_case

pytestmark = pytest.mark.timeout(600)  # one wall learns from the nonlinear shell first

QUICK = Order(Reach.QUICK, 1, tuple(FAMILIES))
# Open faults: what is known to fail, each with its figure in the table that
# the command prints; nothing else may. Who mends one takes it out of here.
TOOLS = {"tool_penetration_hand", "tool_penetration_any"}
OPEN: dict[tuple[str, str], set[str]] = {
    # Rounding of the basis decides by how much: 0.08 and 0.17 mm were seen.
    ("abuse", "all contacts at once, number 0"): TOOLS | {"penetration_hand"},
    # Jaws have contacts with the fold that they hold: 0.11 mm deep in it where 0.1 is asked. Since they close on it
    # until it is solid (walls that meet) it is 0.3, and so is the catheter at their tips in the wall (0.06 before).
    # It gains 0.75 %, and 2.0 % were seen after a heal: how it ends hangs on rounding.
    ("abuse", "jammed, number 0"): TOOLS | {"penetration_hand", "gain"},
    ("abuse", "all contacts at once, wall gives way, number 0"): TOOLS,
    ("grasping", "number 0"): TOOLS,
    # 1.1 % of 34 uJ, where a sphere that touches the wall at speed meets a second triangle a tick later, in overlap.
    ("probing", "wall, 0.3 m/s, number 0"): {"gain"},
    ("effect_pairs", "twist and friction, number 0"): TOOLS,
}


@pytest.mark.parametrize(("family", "case"), list_cases(QUICK), ids=lambda name: name.replace(" ", "-"))
def test_it_meets_its_criteria(family, case):
    result = run_case(QUICK, family, case)
    assert set(result.failed) <= OPEN.get((family, case), set()), result.figures


def test_what_is_known_to_fail_is_in_the_suite():
    assert OPEN.keys() <= set(list_cases(QUICK))
