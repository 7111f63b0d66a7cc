"""A scenario: a scene, what is to be reached in it, which limits hold, and what simulated hands reach (par)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from pydantic import ConfigDict

from services.nearest_word import did_you_mean
from services.runtime import config
from services.runtime.errors import ConfigError

_STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)

Phase = Literal["P0", "P1", "P2", "P3", "P4", "P5", "P6", "P7"]
ErrorCode = Literal["E1", "E2", "E3", "E4", "E5", "E6", "E7", "E8", "E9", "E10", "E11", "E12", "E13", "E14"]

ASSUMPTION = "assumption"


@dataclass(frozen=True, slots=True, kw_only=True)
class Limit:
    """A value in the unit that its name ends with, and where it is from: a source, or `ASSUMPTION`."""

    __pydantic_config__ = _STRICT

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
}
"""Every limit that a scenario may name, with what holds where it does not."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Goal:
    """What ends an attempt well: the catheter's tip so deep, and kept there for a while, in time.

    ``phases`` is the order in which the phases of the procedure must come; empty for any.
    ``forbidden`` are the errors after which the attempt has failed.
    """

    __pydantic_config__ = _STRICT

    depth_m: float
    hold_s: float = 1.0
    time_limit_s: float = 300.0
    phases: tuple[Phase, ...] = ()
    forbidden: tuple[ErrorCode, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """How the scenario is seen and with which hands it is done."""

    __pydantic_config__ = _STRICT

    mirrored: bool = False
    one_handed: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """A file of configs/scenarios.

    ``set`` holds ``key=value`` overrides of the scene; ``par`` maps a metric, unit in its name, to what the simulated
    hands reach; ``name`` is the file's.
    """

    __pydantic_config__ = _STRICT

    name: str
    title: str
    scene: str
    goal: Goal
    hint: str = ""
    set: tuple[str, ...] = ()
    limits: Mapping[str, Limit] = field(default_factory=dict)
    par: Mapping[str, float] = field(default_factory=dict)
    view: View = View()

    def limit(self, name: str) -> float:
        """Return the limit of this name: the scenario's own, else that of `LIMITS`."""
        return (self.limits.get(name) or LIMITS[name]).value


def load_scenario(name: str | Path) -> Scenario:
    """Return the scenario of a file, or of a bare name in configs/scenarios.

    Raises
    ------
    ConfigError
        one sentence that names the file and the key.
    """
    path = config.find("scenario", name)
    scenario = config.build(Scenario, {"name": path.stem} | config.read_yaml(path), str(path))
    if wrong := _fault(scenario):
        raise ConfigError(f"{path}: {wrong}")
    return scenario


def scenario_of(scene: str, name: str | None) -> Scenario | None:
    """Return the scenario of this name; without one the first that is made of the scene as it is, None if none is.

    Raises
    ------
    ConfigError
        if the scenario cannot be used, or is made of another scene.
    """
    if name is None:
        alike = (each for each in _usable() if each.scene == scene)
        return next((each for each in alike if not each.set and each.view == View()), None)
    scenario = load_scenario(name)
    if scenario.scene != scene:
        raise ConfigError(f"scenario {name} is made of scene {scenario.scene!r}: `trocar up --scenario {name}` runs it")
    return scenario


def _usable() -> Iterator[Scenario]:
    """Yield the scenarios; a file that cannot be used is told to who names it, and stands in nobody else's way."""
    for name in scenario_names():
        with suppress(ConfigError):
            yield load_scenario(name)


def scenario_names() -> list[str]:
    """Return the bare names in configs/scenarios."""
    return sorted(path.stem for path in (config.config_directory() / "scenarios").glob("*.yaml"))


def _fault(scenario: Scenario) -> str:
    """Return what is wrong with the first value that cannot be, with its key; empty for nothing."""
    for name, limit in scenario.limits.items():
        if name not in LIMITS:
            return f"limits.{name}: unknown limit; known: {', '.join(LIMITS)}{did_you_mean(name, LIMITS)}"
        if not limit.value > 0.0:
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
