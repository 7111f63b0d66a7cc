"""A scenario: a scene, a goal, limits, and the results of simulated hands (par)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from pydantic import ConfigDict

from trocar.services.messages.nearest_word import did_you_mean
from trocar.services.runtime.config import config
from trocar.services.runtime.errors import ConfigError

STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)

Phase = Literal["P0", "P1", "P2", "P3", "P4", "P5", "P6", "P7"]
ErrorCode = Literal["E1", "E2", "E3", "E4", "E5", "E6", "E7", "E8", "E9", "E10", "E11", "E12", "E13", "E14"]

ASSUMPTION = "assumption"
_STEPS = "reference procedure: technique texts of the catheterisation"


@dataclass(frozen=True, slots=True, kw_only=True)
class Limit:
    """A value in the unit of its name's ending, and its source, or `ASSUMPTION`."""

    __pydantic_config__ = STRICT

    value: float
    source: str = ASSUMPTION


LIMITS: Mapping[str, Limit] = {
    # Horeman 2010, 10.1007/s00464-010-1096-9: experts' largest force, 2.6 (SD 0.4) N, of suturing on a pad.
    "tool_duct_force_n": Limit(value=2.6, source="Horeman 2010, experts' largest force in suturing"),
    # 10.1186/s12909-024-05155-1: experts' thresholds of a grasp, 0.73 to 1.20 N.
    "grasp_force_n": Limit(value=1.2, source="10.1186/s12909-024-05155-1, upper end of experts' grasps"),
    "tool_catheter_force_n": Limit(value=2.0),
    "catheter_wall_force_n": Limit(value=0.5),
    "depth_max_m": Limit(value=0.02, source="technique texts: not beyond the second marker"),
    "depth_min_m": Limit(value=0.01, source="technique texts: at least to the first marker"),
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
"""All limits of scenarios, with defaults; no assumption is clinically validated."""
_LEAST = "bend_radius_m", "clip_min_n", "counter_traction_n", "depth_min_m", "shaft_distance_m", "slipped_out_m"
"""Those of them that are lower limits; 0 disables them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Goal:
    """The goal of an attempt: the catheter's tip at a depth, held there for a while, within a time limit.

    With a ``branch``, the name of an end of the duct, ``depth_m`` is the distance of the tip along the path to it; a
    tip on another branch counts up to the fork. ``phases`` is the required order of the procedure's phases; empty for
    any. ``forbidden`` are the errors that make the attempt fail. A rig judges 12 times a second, so that an attempt may
    end a twelfth of a second after ``hold_s`` or ``time_limit_s``.
    """

    __pydantic_config__ = STRICT

    depth_m: float
    branch: str = ""
    hold_s: float = 1.0
    time_limit_s: float = 300.0
    phases: tuple[Phase, ...] = ()
    forbidden: tuple[ErrorCode, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """View of the scenario, and number of hands."""

    __pydantic_config__ = STRICT

    mirrored: bool = False
    one_handed: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """A file of configs/scenarios.

    ``set`` contains ``key=value`` overrides of the scene; ``par`` maps a metric, with its unit in its name, to the
    result of simulated hands; ``name`` is the file's. With ``cholangiogram`` the report of an attempt shows its end by
    X-rays with contrast agent.
    """

    __pydantic_config__ = STRICT

    name: str
    title: str
    scene: str
    goal: Goal
    hint: str = ""
    set: tuple[str, ...] = ()
    limits: Mapping[str, Limit] = field(default_factory=dict)
    par: Mapping[str, float] = field(default_factory=dict)
    view: View = View()
    cholangiogram: bool = False

    def limit(self, name: str) -> float:
        """Return a limit by name, the scenario's own or that of `LIMITS`."""
        return (self.limits.get(name) or LIMITS[name]).value


def load_scenario(name: str | Path) -> Scenario:
    """Return the scenario of a file, or of a bare name in configs/scenarios.

    Raises ConfigError: one sentence that names the file and the key.
    """
    path = config.find("scenario", name)
    scenario = config.build(Scenario, {"name": path.stem} | config.read_yaml(path), str(path))
    if wrong := _fault(scenario):
        raise ConfigError(f"{path}: {wrong}")
    return scenario


def asks_for_cholangiogram(name: str) -> bool:
    """Return whether a scenario asks for a cholangiogram; one that is not there any more does not, nor no scenario."""
    try:
        return bool(name) and load_scenario(name).cholangiogram
    except ConfigError:
        return False


def scenario_of(scene: str, name: str | None) -> Scenario | None:
    """Return the scenario of this name, by default the first with this unmodified scene, None if there is none.

    Raises ConfigError if the scenario is invalid, or of another scene.
    """
    if name is None:
        alike = (each for each in _usable() if each.scene == scene)
        return next((each for each in alike if not each.set and each.view == View()), None)
    scenario = load_scenario(name)
    if scenario.scene != scene:
        raise ConfigError(f"scenario {name} is made of scene {scenario.scene!r}: `trocar up --scenario {name}` runs it")
    return scenario


def _usable() -> Iterator[Scenario]:
    """Yield the valid scenarios; an invalid file is an error only for those that name it."""
    for name in scenario_names():
        with suppress(ConfigError):
            yield load_scenario(name)


def scenario_names() -> list[str]:
    """Return the bare names in configs/scenarios."""
    return sorted(path.stem for path in (config.config_directory() / "scenarios").glob("*.yaml"))


def _fault(scenario: Scenario) -> str:
    """Return a message on the first invalid value, with its key; empty for none."""
    for name, limit in scenario.limits.items():
        if name not in LIMITS:
            return f"limits.{name}: unknown limit; known: {', '.join(LIMITS)}{did_you_mean(name, LIMITS)}"
        asks_nothing = limit.value == 0.0 and name in _LEAST
        if limit.value <= 0.0 < LIMITS[name].value and not asks_nothing:
            return f"limits.{name}.value: must be positive, is {limit.value:g}"
        if not limit.source.strip():
            return f"limits.{name}.source: must name a source, or say {ASSUMPTION!r}"
    goal = scenario.goal
    for key, value in (("depth_m", goal.depth_m), ("time_limit_s", goal.time_limit_s)):
        if not value > 0.0:
            return f"goal.{key}: must be positive, is {value:g}"
    if not 0.0 <= goal.hold_s < goal.time_limit_s:
        return f"goal.hold_s: must be at least 0 and below time_limit_s, is {goal.hold_s:g}"
    if goal.depth_m > scenario.limit("depth_max_m"):
        return f"goal.depth_m: lies beyond limits.depth_max_m, {scenario.limit('depth_max_m'):g}, is {goal.depth_m:g}"
    if list(goal.phases) != sorted(set(goal.phases)):
        return "goal.phases: each may come once, in the order P0 to P7"
    try:
        config.find("scene", scenario.scene)
    except ConfigError as error:
        return f"scene: {error}"
    return ""
