"""Metrics of an attempt from its trace."""

from __future__ import annotations

import numpy as np

from trocar.review.attempts import motion
from trocar.review.attempts.motion import SAMPLE_HZ, Values
from trocar.review.attempts.trace import Columns
from trocar.services.training.procedure import Procedure
from trocar.services.training.scenario import Scenario
from trocar.services.training.situation import TISSUES

Metrics = dict[str, float]
TISSUE_LIMITS = {
    "tool_duct": "tool_duct_force_n",
    "tool_catheter": "tool_catheter_force_n",
    "catheter_wall": "catheter_wall_force_n",
}
"""The limit of each tissue; a scenario may set it."""


def metrics_of(series: Columns, p: Procedure, scenario: Scenario) -> Metrics:
    """Return what can be measured, unit in the name; what has no meaning in an attempt is left out."""
    found: Metrics = {"time_s": p.time_s, "deepest_m": p.deepest_m}
    for name in ("grasps", "regrasps", "retries", "slips", "drops"):
        found[name] = float(getattr(p, name))
    if len(series.time_s) < 2:
        return found
    found |= _of_tissues(series, scenario)
    speeds: list[Values] = []
    for k, name in enumerate(series.names):
        if len(series.way_s) > 1:
            found |= _named(name, _of_hand(series, k, speeds))
        found |= _named(name, force_metrics(series.time_s, series.load_n[:, k]))
    found |= _named("tip", _of_path(motion.resampled(series.time_s, series.tip_m)))
    return found | _of_both(speeds)


def _named(prefix: str, values: Metrics) -> Metrics:
    return {f"{prefix}.{name}": value for name, value in values.items()}


def _of_hand(series: Columns, k: int, speeds: list[Values]) -> Metrics:
    path_m = motion.resampled(series.way_s, series.position_m[:, k])
    axes = path_m - motion.resampled(series.way_s, series.port_m[:, k])
    axes /= np.maximum(np.linalg.norm(axes, axis=1), 1e-9)[:, None]
    speeds.append(motion.speed(path_m))
    found = _of_path(path_m)
    ideal_m = _ideal_length(series, path_m)
    if found["path_m"] > 0.0:
        found["economy"] = min(1.0, ideal_m / found["path_m"])
    found["depth_m"] = motion.depth_length(path_m, axes)
    found["angular_path_rad"] = float(np.arccos(np.clip(np.einsum("ij,ij->i", axes[1:], axes[:-1]), -1.0, 1.0)).sum())
    found["idle_share"] = float((speeds[-1] < motion.IDLE_M_S).mean())
    return found


def _ideal_length(series: Columns, path_m: Values) -> float:
    """Return the straight ways from phase to phase: the shortest path through the places where they changed."""
    changes = np.flatnonzero(np.diff(series.phase)) + 1
    times = series.time_s[[0, *changes.tolist(), len(series.time_s) - 1]]
    places = np.minimum(((times - series.time_s[0]) * SAMPLE_HZ).round().astype(int), len(path_m) - 1)
    return motion.path_length(path_m[places])


def _of_path(path_m: Values) -> Metrics:
    speed_m_s = motion.speed(path_m)
    found = {"path_m": motion.path_length(path_m), "movements": float(len(motion.movements(speed_m_s)))}
    found["motion_frequency_hz"] = motion.motion_frequency(speed_m_s)
    shapes: dict[str, motion.Measure] = {"sparc": motion.sparc, "ldlj": motion.log_dimensionless_jerk}
    for name, measure in shapes.items():
        value = motion.over_movements(measure, speed_m_s)
        if value is not None:
            found[name] = value
    return found


def _of_both(speeds: list[Values]) -> Metrics:
    if len(speeds) < 2:
        return {}
    one, other = speeds[:2]
    found = {"bimanual_share": float(((one > motion.MOVES_M_S) & (other > motion.MOVES_M_S)).mean())}
    if one.std() > 0.0 and other.std() > 0.0:
        found["speed_correlation"] = float(np.corrcoef(one, other)[0, 1])
    return found


def _of_tissues(series: Columns, scenario: Scenario) -> Metrics:
    """Return peak, time above the limit and tissue load, the integral of what is above it, for each tissue."""
    found: Metrics = {}
    for k, tissue in enumerate(TISSUES):
        limit_n = scenario.limit(TISSUE_LIMITS[tissue])
        found |= _named(tissue, force_metrics(series.time_s, series.tissue_n[:, k], limit_n))
    return found


def force_metrics(time_s: Values, force_n: Values, limit_n: float | None = None) -> Metrics:
    """Return peak, root mean square, mean and deviation where it is not zero; with a limit what is above it."""
    steps_s = np.diff(time_s, append=time_s[-1])
    acts = force_n > 0.0
    total_s = float(steps_s.sum())
    found = {"peak_n": float(force_n.max())}
    if total_s > 0.0:
        found["rms_n"] = float(np.sqrt((force_n**2 * steps_s).sum() / total_s))
    if acts.any():
        found |= {"mean_n": float(force_n[acts].mean()), "deviation_n": float(force_n[acts].std())}
    if limit_n is not None:
        above = np.maximum(force_n - limit_n, 0.0)
        found |= {"above_limit_s": float(steps_s[above > 0.0].sum()), "load_n_s": float((above * steps_s).sum())}
    return found
