"""Limits of what counts as an error, each with its source: those that a scenario may name, and the rest."""

from __future__ import annotations

from collections.abc import Mapping

from services.training.scenario import LIMITS, Limit, Scenario

_STEPS = "reference procedure: technique texts of the catheterisation"

ERROR_LIMITS: Mapping[str, Limit] = {
    **LIMITS,
    "rim_load_n": Limit(value=1.0),
    "rim_opening_ratio": Limit(value=1.3),
    "probe_force_n": Limit(value=0.03),
    "withdrawal_m": Limit(value=2e-3, source=_STEPS),
    "tip_force_n": Limit(value=1.0),
    "penetration_m": Limit(value=0.5e-3),
    "jump_m": Limit(value=5e-3),
    "push_force_n": Limit(value=0.5),
    "stalled_m_s": Limit(value=0.2e-3, source=_STEPS),
    "buckling_ratio": Limit(value=1.15, source=_STEPS),
    "depth_min_m": Limit(value=0.01, source="technique texts: at least to the first marker"),
    "slipped_out_m": Limit(value=1e-3),
    "crush_force_n": Limit(value=3.0),
    "bend_radius_m": Limit(value=4e-3),
    "clip_max_n": Limit(value=1.5),
    "clip_min_n": Limit(value=0.3),
    "air_s": Limit(value=0.05),
    "direction_cosine": Limit(value=0.0, source=_STEPS),
    "view_angle_rad": Limit(value=0.75),
    "shaft_distance_m": Limit(value=5e-3, source="two shafts of 5 mm touch"),
    "blind_force_n": Limit(value=0.2),
    "dropped_s": Limit(value=0.5),
    "hold_slip_m": Limit(value=2e-3),
    "losses": Limit(value=0.0),
    "regrasps": Limit(value=6.0),
    "counter_traction_n": Limit(value=0.01),
}
"""Every limit; none of those marked as an assumption is clinically validated."""


def limit_of(scenario: Scenario, name: str) -> float:
    """Return the limit of this name: the scenario's own, else that of `ERROR_LIMITS`."""
    return (scenario.limits.get(name) or ERROR_LIMITS[name]).value
