"""Cases of other seeds that gained energy from nowhere: found by sampling, mended at their cause, kept.

They are part of the long run: by day, one case of every family speaks for all.
"""

from dataclasses import replace

import pytest

from trocar.services.mechanics.effects.base import NoSettings
from trocar.studies.stability.drive import drive
from trocar.studies.stability.families.probing import cases as probing
from trocar.studies.stability.family import Draw, Reach
from trocar.studies.stability.situations import with_catheter, with_effects
from trocar.studies.stability.suite import Order, run_case

pytestmark = [pytest.mark.long, pytest.mark.timeout(600)]

CLAMPED = {"anchor": "clamped", "length_m": 80e-3, "n_segments": 40}

# Each with what it gained before, over the largest energy in it; 0.01 is asked.
GAINED = [
    (12, "mass", "catheter 0.1 times as heavy, number 1", 0.16),
    (13, "mass", "catheter 0.1 times as heavy, number 3", 0.36),
    (12, "abuse", "pulled out sideways at 1 m/s, number 4", 0.015),
    (12, "abuse", "pulled out sideways at 1 m/s, number 7", 0.016),
    (12, "effect_pairs", "twist and gallstones, number 1", 0.028),
    (13, "effect_pairs", "gallstones and friction, number 0", 0.018),
    # Rounding decided: 0.005 to 0.39 were seen.
    (1, "jerks", "holding, 0.1 m/s, number 96", 0.39),
    # A bent catheter swung along its introducer from tick to tick, too slowly to be looked at.
    (1, "jerks", "approaching, 0.1 m/s, number 149", 0.020),
    # Forces that alternate from tick to tick swung modes of the wall that a step does not resolve.
    (1, "jumps", "beside, tool 1 by 2 mm along -z and back", 0.085),
    (3, "mass", "wall 0.01 times as heavy, number 2", 0.098),
    (3, "mass", "wall 0.01 times as heavy, number 3", 0.139),
    # A soft catheter bent hard at its introducer's edge was pulled along the kink that was there before.
    (1, "stiffness", "0.1 times as stiff, holding, number 2", 0.012),
    # Contact forces that fell off gave back half of what the rod had lost as they came.
    (1, "probing", "catheter, 0.3 m/s, number 27", 0.0137),
    (1, "probing", "catheter, 0.5 m/s, number 27", 0.0246),
    # A heal took up a state that stored more than there was.
    (1, "mass", "wall 0.01 times as heavy, number 2", 0.051),
    (1, "stiffness", "10 times as stiff, holding, number 2", 0.171),
    # A second look took a catheter that had been planned again back to where the plan before had led it.
    (1, "stiffness", "10 times as stiff, holding, number 1", 0.028),
    (1, "stiffness", "100 times as stiff, holding, number 3", 0.011),
    # The second point of a grip was a guide whose axes turned with the catheter, and bore nothing along it.
    (1, "jerks", "holding, 0.1 m/s, number 32", 0.047),
    (1, "jerks", "holding, 1 m/s, number 76", 0.0125),
    (1, "abuse", "dragged over the rim, number 10", 0.015),
]


@pytest.mark.parametrize(("seed", "family", "case", "before"), GAINED)
def test_it_gains_nothing(seed, family, case, before):
    result = run_case(Order(Reach.LONG, seed, (family,)), family, case)
    assert not {"gain", "imbalance", "speed", "stretch", "rest"} & set(result.failed), result.figures
    assert result.figures["gain"] < 0.5 * min(before, 0.01)


@pytest.mark.parametrize(
    ("case", "change", "before"),
    [
        ("catheter, 0.3 m/s, number 27", lambda scene: with_effects(scene, {"twist": NoSettings()}), 0.0137),
        ("catheter, 0.5 m/s, number 27", lambda scene: with_effects(scene, {"twist": NoSettings()}), 0.0246),
        ("catheter, 0.5 m/s, number 11", lambda scene: with_catheter(scene, **CLAMPED), 0.0018),
    ],
)
def test_a_catheter_with_twist_or_a_clamp_gains_nothing_either(case, change, before, monkeypatch):
    """What contact forces gave back as they fell off was taken out of plain ones in an introducer only."""
    monkeypatch.setattr("trocar.studies.stability.family.drive", lambda play: play)
    (play,) = [each.run() for each in probing(Draw(Reach.LONG, 1)) if each.name == case]
    assert drive(replace(play, scene=change(play.scene))).figures["gain"] < 0.01 * before


# An overlap that was taken back, or a solve that was cut short, put in what nobody had; and the rows of holds found no
# room beside those of pairs, so that they came back stretched (the last). Each with what it gained.
TAKEN_BACK = [
    (1, "abuse", "jammed, number 6", 0.060),
    (1, "numbers", "inf in jaw_angle_rad, number 1", 0.032),
    (1, "jerks", "holding, 2 m/s, number 144", 0.017),
    (1, "grasping", "number 14", 0.012),
    (1, "stiffness", "10 times as stiff, holding, number 5", 0.088),
]


@pytest.mark.parametrize(("seed", "family", "case", "before"), TAKEN_BACK)
def test_what_overlaps_are_taken_back_by_comes_from_nowhere_else(seed, family, case, before):
    result = run_case(Order(Reach.LONG, seed, (family,)), family, case)
    assert not {"gain", "imbalance", "speed", "stretch", "rest"} & set(result.failed), result.figures
    assert result.figures["gain"] < min(3e-3, 0.1 * before)


def test_a_light_catheter_in_its_seal_gains_nothing():
    """In one tick the solve ends before it converges: 1e-5 to 0.008 were seen, and 0.25 before that."""
    result = run_case(Order(Reach.LONG, 11, ("mass",)), "mass", "catheter 0.01 times as heavy, number 0")
    assert not {"imbalance", "speed", "stretch", "rest"} & set(result.failed), result.figures
    assert result.figures["gain"] < 3e-3


# Where collision told wrong sides: jaws off a fold that they had turned inside out, catheters that had slipped through
# jaws. And a heal that stretched couplings again.
WRONG_SIDES = [
    (1, "abuse", "jaws shut on the wall, number 1", 0.049, 6.3e-3),
    (12, "grasping", "number 6", 0.123, 3.8e-3),
    (1, "jumps", "holding, tool 0 by 50 mm along -x", 0.307, 1.3e-3),
]


@pytest.mark.parametrize(("seed", "family", "case", "gained", "deep_m"), WRONG_SIDES)
def test_it_is_on_the_right_side(seed, family, case, gained, deep_m):
    result = run_case(Order(Reach.LONG, seed, (family,)), family, case)
    assert "gain" not in result.failed, result.figures
    assert result.figures["tool_penetration_any"] * 1e-3 < deep_m, result.figures
    assert result.figures["gain"] < 0.2 * gained


# A catheter that slips through the jaws that hold it was taken for pressed right through them as soon as they let go,
# and thrown back. Each with what it gained by that, and how deep it was.
SLIPPED_THROUGH = [
    (1, "stiffness", "1000 times as stiff, beside, number 1", 0.208, 4.0e-3),
    (1, "stiffness", "1000 times as stiff, holding, number 3", 0.148, 4.0e-3),
    (2, "stiffness", "1000 times as stiff, holding, number 5", 0.013, 3.6e-3),
]


@pytest.mark.parametrize(("seed", "family", "case", "gained", "deep_m"), SLIPPED_THROUGH)
def test_jaws_that_let_go_meet_what_they_held_where_it_is(seed, family, case, gained, deep_m):
    result = run_case(Order(Reach.LONG, seed, (family,)), family, case)
    assert not {"gain", "tool_penetration_any"} & set(result.failed), result.figures
    assert result.figures["gain"] < 0.5 * gained
    assert result.figures["tool_penetration_any"] * 1e-3 < 0.1 * deep_m


# A wall between jaws swelled no faster than overlaps are taken back; a fold's ridge had no room; a grasp let its jaws
# into the wall; the tip of a jaw saw nothing. Each with how deep a tool was in the wall, and what was gained.
SQUEEZED = [
    ("jaws shut on the wall, number 1", 0.20e-3, 1e-3),
    ("jaws shut on both, number 0", 0.39e-3, 1e-3),
    ("jammed, number 1", 0.26e-3, 7.3e-3),
    ("jammed, number 6", 4.28e-3, 60e-3),
]


@pytest.mark.parametrize(("case", "deep_m", "gained"), SQUEEZED)
def test_jaws_are_not_deep_in_what_they_squeeze(case, deep_m, gained):
    result = run_case(Order(Reach.LONG, 1, ("abuse",)), "abuse", case)
    assert "penetration_any" not in result.failed
    assert result.figures["tool_penetration_hand"] < 0.55 * deep_m, result.figures
    assert result.figures["tool_penetration_hand"] < 0.12e-3, result.figures
    assert result.figures["gain"] < 0.25 * gained


# A wall that turned to and fro about the catheter sank into it, each time about another point; and a wire in a squeezed
# wall had more contacts than there was room for. Each with how deep the catheter was in the wall.
SUNK_IN = [
    (1, "abuse", "jammed, number 1", 0.309e-3),
    (2, "abuse", "jammed, number 9", 0.198e-3),
    (3, "abuse", "jammed, number 9", 0.315e-3),
    (1, "stiffness", "1000 times as stiff, holding, number 1", 0.384e-3),
    (1, "mass", "wall 0.01 times as heavy, number 1", 0.316e-3),
]


@pytest.mark.parametrize(("seed", "family", "case", "deep_m"), SUNK_IN)
def test_a_wall_does_not_roll_into_the_catheter(seed, family, case, deep_m):
    result = run_case(Order(Reach.LONG, seed, (family,)), family, case)
    assert not {"gain", "rest"} & set(result.failed), result.figures
    if family == "mass":
        assert result.figures["penetration_hand"] < 0.4 * deep_m
    else:  # known: by the outside judge the catheter is deep between its particles, where rows see nothing
        assert "penetration_hand" in result.failed, result.figures
    assert result.figures["healed"] == 0


def test_jaws_at_rest_see_a_wall_that_bulges_between_the_points_that_they_press():
    """It rose by a few micrometres a tick beside them, and was found 0.110 mm deep."""
    result = run_case(Order(Reach.LONG, 1, ("jerks",)), "jerks", "beside, 0.2 m/s, number 126")
    assert not result.failed, result.figures
    assert result.figures["tool_penetration_hand"] < 0.08e-3


# What these cases asked was not what they did: the catheter on springs touched nothing, and at finer steps the hands
# jerked a thousand times a second.
ASKED = [
    *(
        ("theory", f"penalty contact with {stiffness} m/dt^2", "theory", 0.0)
        for stiffness in ("0.03", "0.1", "10", "100")
    ),
    ("sticking", "seal broken at 50 mm/s, 0.25 ms", "law", 0.02),
    ("sticking", "seal broken at 10 mm/s, 0.25 ms", "law", 0.02),
]


@pytest.mark.parametrize(("family", "case", "criterion", "most"), ASKED)
def test_it_does_what_the_law_says(family, case, criterion, most):
    result = run_case(Order(Reach.LONG, 1, (family,)), family, case)
    assert not result.failed, result.figures
    assert result.figures[criterion] <= most
