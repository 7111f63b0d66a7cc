"""The page of the Python API: every array that public names of `trocar` show stands there with shape, unit and frame.

They are found by walking the objects themselves, so that one which is added, renamed or reshaped fails here.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import trocar
from trocar.envs import HandLimits
from trocar.envs.hands import DeviceHands
from trocar.services.mechanics.scene.tools import ToolResults

PAGE = (Path(__file__).parents[2] / "docs" / "reference" / "python-api.md").read_text(encoding="utf-8")
SMALL = ("duct.n_around=20", "duct.n_along=26", "duct.n_modes=40", "catheter.n_segments=34")
OURS = ("trocar.services.mechanics.", "trocar.")
FRAMES = ("scene", "contact", "modes", "")
#: Parts of parts that are told of; of all others only those that a simulation shows itself.
FURTHER = ("simulation.catheter.state", "simulation.duct.state", "simulation.world.pairs")


def _simulation() -> trocar.Simulation:
    """Return a simulation that is touched, with other sizes for each thing that a shape may be made of."""
    simulation, hands = trocar.simulate(trocar.load_scene("insertion", SMALL)), trocar.Hands()
    trocar.expert(simulation).write_inputs(0.0, hands)
    for _ in range(3):
        simulation.step(hands)
    assert simulation.contacts.n_contacts > 0
    return simulation


def _roots() -> dict[str, Any]:
    simulation = _simulation()
    hands = DeviceHands(simulation.scene.forceps, HandLimits(), np.zeros(3))
    functions = {"wall_m": trocar.wall_m(simulation), "tip_m": trocar.tip_m(simulation)}
    hold = trocar.GraspHold(2, 0, 1, 3, np.array([0.5, 0.5, 0.0]), 1.0, 0.1)
    roots = {"trocar": functions, "Hands": trocar.Hands(), "GraspHold": hold, "env": {"hands": hands}}
    return roots | {"simulation": simulation}


def _shown(of: Any) -> Iterator[tuple[str, Any]]:
    """Yield the public attributes of an object."""
    if isinstance(of, dict):
        yield from of.items()
        return
    for name in dir(of):
        if not name.startswith("_"):
            yield name, getattr(of, name, None)


def _walk(roots: dict[str, Any]) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the arrays of objects by their path, and those of objects that these show: each by its shortest path."""
    queue, seen = deque(roots.items()), set[int]()
    while queue:
        path, of = queue.popleft()
        if id(of) in seen:
            continue
        seen.add(id(of))
        for attribute, value in _shown(of):
            inner = f"{path}.{attribute}"
            if isinstance(value, np.ndarray):
                yield inner, value
            elif (path in roots or inner in FURTHER) and type(value).__module__.startswith(OURS):
                queue.append((inner, value))


def _told() -> dict[str, tuple[str, str, str]]:
    """Return shape, unit and frame of the arrays on the page, by their path."""
    told: dict[str, tuple[str, str, str]] = {}
    prefix = ""
    for line in PAGE.splitlines():
        cells = [cell.strip() for cell in line.split("|")[1:-1]]
        if line.startswith("| **`"):
            prefix = cells[0].strip("*`")
        elif prefix and line.startswith("| `") and len(cells) == 4:
            for name in re.findall(r"`([\w.]+)`", cells[0]):
                assert f"{prefix}.{name}" not in told
                told[f"{prefix}.{name}"] = (cells[1], cells[2], cells[3])
        elif not line.startswith("|"):
            prefix = ""
    return told


@pytest.fixture(scope="module")
def shown() -> dict[str, np.ndarray]:
    return dict(_walk(_roots()))


def test_every_array_is_on_the_page_and_no_other(shown: dict[str, np.ndarray]) -> None:
    assert len(shown) > 100
    assert sorted(shown) == sorted(_told())


def test_shapes_and_types_are_as_told_and_a_letter_is_one_number_throughout(shown: dict[str, np.ndarray]) -> None:
    letters: dict[str, set[int]] = {}
    for name, (told, _, _) in _told().items():
        shape, _, dtype = told.partition(") ")
        assert str(shown[name].dtype) == (dtype or "float64"), name
        sizes = [each.strip() for each in shape.strip("()").split(",") if each.strip()]
        assert len(sizes) == shown[name].ndim, name
        for size, found in zip(sizes, shown[name].shape, strict=True):
            factor, letter = re.fullmatch(r"(\d*)([A-Za-z]?)", size).groups()  # type: ignore[union-attr]
            if letter:
                letters.setdefault(letter, set()).add(found // int(factor or 1))
            assert letter or found == int(factor), name
    assert all(len(numbers) == 1 for numbers in letters.values()), letters
    assert len({next(iter(numbers)) for letter, numbers in letters.items() if letter not in "CN"}) == len(letters) - 2


def test_units_and_frames_are_told() -> None:
    assert all(unit and frame in FRAMES for _, unit, frame in _told().values())


def test_results_of_the_hands_are_those_of_the_front_door() -> None:
    assert trocar.HandResults is ToolResults
