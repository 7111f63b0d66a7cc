"""Hints for the trainee on what to do next, shown while their reason lasts."""

from __future__ import annotations

from trocar.services.training.attempt import AttemptState, FollowedAttempt
from trocar.services.training.rig_observer import RigObserver
from trocar.services.training.scenario import Scenario

#: Fraction of a force limit from which a hint asks for less.
_NEAR = 0.8
_NEARLY_M = 2e-3  # a hint counts whole millimetres, so that the last one told is 2 mm


def hint(attempt: FollowedAttempt, observer: RigObserver, scenario: Scenario | None) -> str:
    """Return one sentence, empty for none."""
    if scenario is None or attempt.ended:
        return ""
    if attempt.state is AttemptState.ARMED:
        if attempt.depth_m > 0.0:
            return "Begin again: the catheter is in already."
        return scenario.hint or "Begin: the clock starts with your first motion."
    if observer.force_n > _NEAR * scenario.limit("tool_duct_force_n"):
        return "Less force: the wall bears no more."
    if attempt.depth_m > scenario.limit("depth_max_m"):
        return "Too deep: draw the catheter back to the marker."
    to_go_m = scenario.goal.depth_m - attempt.depth_m
    if to_go_m <= 0.0:
        return "Hold it there."
    if scenario.goal.branch:
        return f"On to {scenario.goal.branch.replace('_', ' ')}: {1e3 * to_go_m:.0f} mm to go."
    if "catheter" not in observer.held:
        return "Grasp the catheter." if attempt.depth_m == 0.0 else "Grasp the catheter again, farther back."
    if attempt.depth_m == 0.0:
        return "Lead the tip of the catheter into the mouth of the duct."
    return "Gently: almost there." if to_go_m < _NEARLY_M else f"Push on: {1e3 * to_go_m:.0f} mm to go."
