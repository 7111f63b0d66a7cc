"""What hands must not do to a catheter and a duct: jam, buckle, drag, tear."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from trocar.services.mechanics.effects import EFFECTS
from trocar.services.mechanics.effects.gallstones import GallstonesSettings
from trocar.services.mechanics.scene.tools import N_TOOLS
from trocar.studies.stability.drive import Play
from trocar.studies.stability.family import Case, Draw, played
from trocar.studies.stability.hands import HandMotions, junction, least_jerk, still
from trocar.studies.stability.situations import LEAD_STEPS, Situation, approaching, threaded, with_effects

Way = tuple[float, float, tuple[float, float, float]]
"""Distance in m, top speed in m/s, direction."""
COUNT = 12
QUICK = "jammed", "pulled apart by both tools", "all contacts at once", "all contacts at once, wall gives way"
BUCKLING_N = 5.0
COMES_M = 15e-3
"""From so far out jaws come that are not about the wall from the start."""


def cases(draw: Draw) -> Iterator[Case]:
    """Every kind of abuse, each with small changes of direction and speed."""
    for what in KINDS if draw.is_long else QUICK:
        for k in range(COUNT if draw.is_long else 1):
            name = f"{what}, number {k}"
            yield played(name, partial(_varied, draw, name, KINDS[what]))


def _varied(draw: Draw, name: str, play: Callable[[np.random.Generator], Play]) -> Play:
    return play(draw.random(f"abuse {name}"))


def _pushed(start: Situation, random: np.random.Generator, ways: dict[int, Way], lead: int = LEAD_STEPS) -> Play:
    """Move tools by (distance, speed, direction) after so many steps, stay for 100 ms, and leave."""
    hands = start.hands
    longest = 0
    for tool, (distance_m, speed_m_s, direction) in ways.items():
        aim = np.asarray(direction) + 0.1 * random.normal(size=3)
        way = least_jerk(distance_m, aim / np.linalg.norm(aim), speed_m_s)
        longest = max(longest, len(way))
        hands = hands.then(max(lead + longest + 100 - len(hands), 0)).moved(tool, way, lead)
    return Play(scene=start.scene, hands=hands)


def _jammed(random: np.random.Generator) -> Play:
    """Held fast by the steadying jaws through the wall, and pushed on."""
    start = threaded()
    shut = replace(start, hands=start.hands.with_jaws(1, np.linspace(0.8, 0.1, 100), LEAD_STEPS - 100))
    return _pushed(shut, random, {0: (25e-3, 0.2, (-1.0, 0.0, 0.0)), 1: (1e-3, 0.2, (0.0, 0.0, -1.0))})


def _buckled(random: np.random.Generator) -> Play:
    """Aimed at the rim and pushed with 5 N: so far does the coupling stretch."""
    start = approaching()
    stiffness = start.scene.forceps[0].coupling_stiffness_n_m
    hands = start.hands.moved(0, least_jerk(2.5e-3, np.array([0.0, 1.0, 0.0]), 0.1), LEAD_STEPS - 100)
    reach_m = 12e-3 + BUCKLING_N / stiffness
    return _pushed(replace(start, hands=hands), random, {0: (reach_m, 0.3, (-1.0, 0.0, 0.0))})


def _over_rim(random: np.random.Generator) -> Play:
    return _pushed(threaded(), random, {0: (30e-3, 0.4, (0.5, 0.8, 0.4))})


def _sideways(random: np.random.Generator) -> Play:
    angle = random.uniform(0.0, 2.0 * np.pi)
    return _pushed(threaded(), random, {0: (40e-3, 1.0, (0.0, np.cos(angle), np.sin(angle)))})


def _apart(random: np.random.Generator) -> Play:
    """Both tools hold the catheter between mouth and introducer, and pull."""
    start = approaching()
    left, right = start.scene.forceps
    right = replace(right, port_position_m=(60e-3, 70e-3, 110e-3))
    scene = replace(start.scene, forceps=(left, right))
    points = np.array([junction(left, (76e-3, 0.0, 0.0), 10e-3), junction(right, (56e-3, 0.0, 0.0), 10e-3)])
    hands = _shutting(still(points, (0.7, 0.7), LEAD_STEPS), (0.05, 0.05), 150, 20)
    aim = (0.4, 0.6, 0.6)
    opposite = (-0.4, -0.6, -0.6)
    return _pushed(Situation(scene, hands), random, {0: (30e-3, 0.5, aim), 1: (30e-3, 0.5, opposite)})


def _shut(where_m: tuple[float, float, float], random: np.random.Generator) -> Play:
    """Jaws shut fully on what is there, are torn open at once, and pull."""
    start = threaded()
    right = start.scene.forceps[1]
    points = start.hands.position_m[0].copy()
    points[1] = junction(right, where_m, 10e-3)
    hands = still(points, (0.7, 1.15), LEAD_STEPS)
    for tool, shut_rad in enumerate((0.25, 0.0)):
        hands = hands.with_jaws(tool, np.linspace(hands.jaw_angle_rad[0, tool], shut_rad, 150), 20)
    return _pushed(replace(start, hands=hands), random, {1: (8e-3, 0.3, (0.0, 0.3, 0.9))})


def _shut_and_pull(where_m: tuple[float, float, float], random: np.random.Generator) -> Play:
    """Jaws come down, shut on what is there, stay so, pull, and let go, most within 0.1 s; each in its own way."""
    start, wide_rad = threaded(), 1.15
    right = start.scene.forceps[1]
    points = start.hands.position_m[0].copy()
    x_m, y_m, z_m = np.asarray(where_m) + random.uniform(-1.0, 1.0, 3) * (2e-3, 0.5e-3, 1e-3)
    points[1] = junction(right, (float(x_m), float(y_m), float(z_m)), 10e-3)
    out = np.asarray(right.port_position_m) - points[1]
    out /= np.linalg.norm(out)
    points[1] += COMES_M * out
    shut_rad, steps, opens = random.uniform(0.0, 0.15), int(random.integers(60, 200)), int(random.geometric(0.03))
    comes = least_jerk(COMES_M, -out, 0.3)
    hands = still(points, (0.7, wide_rad), len(comes) + 20 + LEAD_STEPS).moved(1, comes, 0)
    hands = _shutting(hands, (0.25, shut_rad), steps, len(comes) + 20)
    play = _pushed(replace(start, hands=hands), random, {1: (8e-3, 0.3, (0.0, 0.3, 0.9))}, len(hands))
    opening = np.minimum(np.arange(1, 151) / opens, 1.0)
    opened = play.hands.then(len(opening)).with_jaws(1, shut_rad + (wide_rad - shut_rad) * opening, len(play.hands))
    return replace(play, hands=opened)


def _shutting(hands: HandMotions, shut_rad: tuple[float, float], steps: int, first: int) -> HandMotions:
    """Close the jaws of both tools in so many steps from the first on, and keep them shut."""
    for tool in range(N_TOOLS):
        closing = np.linspace(hands.jaw_angle_rad[0, tool], shut_rad[tool], steps)
        stays = np.full(len(hands) - first - steps, shut_rad[tool])
        hands = hands.with_jaws(tool, np.append(closing, stays), first)
    return hands


def _everything(left_out: tuple[str, ...], random: np.random.Generator) -> Play:
    """All effects but some, two stones, both tools shut and moving: every contact at once."""
    start = threaded()
    names = [name for name in EFFECTS if name not in start.scene.effects and name not in left_out]
    effects = {name: EFFECTS[name].kind.Settings() for name in names}
    effects["gallstones"] = GallstonesSettings(((22e-3, 0.0, -1.5e-3), (14e-3, 0.5e-3, -1.5e-3)), (1.5e-3, 1.2e-3))
    scene = with_effects(start.scene, effects)
    scene = replace(scene, contact=replace(scene.contact, capacity=160))
    shut = replace(start, scene=scene, hands=start.hands.with_jaws(1, np.linspace(0.8, 0.3, 100), LEAD_STEPS - 100))
    return _pushed(shut, random, {0: (15e-3, 0.3, (-1.0, 0.1, 0.1)), 1: (4e-3, 0.2, (0.3, 0.3, -0.5))})


KINDS: dict[str, Callable[[np.random.Generator], Play]] = {
    "jammed": _jammed,
    "buckled by 5 N": _buckled,
    "dragged over the rim": _over_rim,
    "pulled out sideways at 1 m/s": _sideways,
    "pulled apart by both tools": _apart,
    "jaws shut on the wall": partial(_shut, (34e-3, 0.0, 4e-3)),
    "jaws shut on the catheter": partial(_shut, (52e-3, 0.0, 0.0)),
    "jaws shut on both": partial(_shut, (36e-3, 0.0, 0.0)),
    "jaws shut on the wall and pull": partial(_shut_and_pull, (34e-3, 0.0, 4e-3)),
    "jaws shut on both and pull": partial(_shut_and_pull, (36e-3, 0.0, 0.0)),
    "all contacts at once": partial(_everything, ("softening",)),
    "all contacts at once, wall gives way": partial(_everything, ()),
}
