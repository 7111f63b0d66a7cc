"""``trocar attempt``: orders to the attempt that is being made, and how it stands; ``trocar scenarios``."""

from __future__ import annotations

import json
import secrets
from collections.abc import Iterator
from typing import Any

import trocar.protocol.bodies as bodies
from trocar.services.cli.arm import WHO, page_of, print_answer, state_at
from trocar.services.runtime.config import config
from trocar.services.runtime.errors import BusError, ConfigError
from trocar.services.supervisor.control.commands import Command
from trocar.services.training.scenario import Scenario, load_scenario, scenario_names


def made_of(name: str, scene: str | None, overrides: tuple[str, ...]) -> tuple[str, tuple[str, ...]]:
    """Return the scene of a scenario, and the overrides that make a rig of it; those given come after its own.

    Raises ConfigError if the scenario cannot be used, or another scene is named beside it.
    """
    scenario = load_scenario(name)
    if scene not in (None, scenario.scene):
        raise ConfigError(f"--scene {scene}: scenario {name} is made of scene {scenario.scene}; name one of both")
    return scenario.scene, (*scenario.set, *overrides, f"training.scenario={name}")


def run_order(rig: str, overrides: tuple[str, ...], what: str, value: float = 0.0) -> None:
    """Send an order and print what became of it."""
    order = bodies.Order(id=secrets.randbits(53), what=what, value=value)
    print_answer(config.load_rig(rig, overrides), Command(what="attempt", who=WHO, order=order))


def run_status(rig: str, overrides: tuple[str, ...], as_json: bool) -> None:
    """Print the attempt as the rig's page has it.

    Raises BusError if there is no rig, or nothing in it follows attempts.
    """
    page = page_of(config.load_rig(rig, overrides))
    attempt = state_at(page).get("attempt")
    if attempt is None:
        raise BusError(f"the rig at {page.address} says of no attempt: has it a training process?")
    print(json.dumps(attempt) if as_json else "\n".join(_lines(attempt)))


def _lines(attempt: dict[str, Any]) -> Iterator[str]:
    yield f"{attempt['title']}: {attempt['state']}{', ' * bool(attempt['outcome'])}{attempt['outcome']}"
    limit = f" of {attempt['time_limit_s']:g} s" if attempt["time_limit_s"] else ""
    pace = "" if attempt["pace"] == 1.0 else f", at {attempt['pace']:g} of the clock" if attempt["pace"] else ", paused"
    yield f"time {attempt['time_s']:.1f} s{limit}{pace}"
    goal = f", goal {1e3 * attempt['goal_depth_m']:.0f} mm" if attempt["goal_depth_m"] else ""
    yield f"depth {1e3 * attempt['depth_m']:.1f} mm{goal}"
    if attempt["errors"]:
        yield "errors " + ", ".join(f"{code} {count}" for code, count in sorted(attempt["errors"].items()))
    if not attempt["counts"]:
        yield f"this attempt does not count: {attempt['why_not']}"
    yield from filter(None, (attempt["reason"], attempt["hint"]))


def run_scenarios(as_json: bool) -> None:
    """List the scenarios."""
    found = [load_scenario(name) for name in scenario_names()]
    if as_json:
        print(json.dumps([{"name": each.name, "title": each.title, "scene": each.scene} for each in found]))
        return
    width = max((len(each.name) for each in found), default=0)
    for each in found:
        print(f"{each.name:{width}}  {_in_a_line(each)}")


def _in_a_line(scenario: Scenario) -> str:
    goal = scenario.goal
    return f"{scenario.title}: {1e3 * goal.depth_m:g} mm within {goal.time_limit_s:g} s (scene {scenario.scene})"
