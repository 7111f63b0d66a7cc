"""The mechanics gives what it gave when the runs beside this file were recorded."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest

from . import stored
from .cases import CASES
from .compare import deviations, first_difference
from .observe import RAGGED, machine, run

pytestmark = pytest.mark.timeout(600)

# On another kind of machine sums are rounded otherwise, and contact amplifies that: a duct that slips between jaws does
# so a tick earlier or later. Three times what `python -m tests.mechanics.trajectories sensitivity` measured when every
# state was moved by a rounding error in every tick: see `compare.deviations` for what is bounded.
TOLERANCE = {
    "insertion": {
        "wall_m": 92e-6,
        "catheter_m": 53e-6,
        "stone_m": 252e-6,
        "tool_force_n": 2.4e-3,
        "grasp_torque_nm": 73e-6,
        "proxy_m": 4.7e-6,
        "inserted_m": 16e-6,
    },
    "pinch": {
        "wall_m": 0.46e-3,
        "catheter_m": 2e-9,
        "tool_force_n": 42e-3,
        "grasp_torque_nm": 2.9e-3,
        "proxy_m": 84e-6,
        "inserted_m": 0.0,
    },
    "anatomy": {
        "wall_m": 23e-6,
        "catheter_m": 2e-9,
        "tool_force_n": 0.14e-3,
        "grasp_torque_nm": 0.24e-6,
        "proxy_m": 0.27e-6,
        "inserted_m": 0.0,
    },
}


@pytest.fixture(scope="module")
def apart():
    """A process that runs nothing else, as the one that has recorded the runs.

    A kernel that another test has compiled for strided arrays would serve here too, and sum in another order.
    """
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        yield pool


@pytest.fixture(scope="module", params=CASES)
def both(request, own_cache, apart):
    """A recorded run and the same of today."""
    try:
        today = apart.submit(_run, request.param, own_cache / "bases").result()
    except FileNotFoundError as missing:
        pytest.skip(f"needs the scan {missing}")
    return request.param, stored.load(request.param), today


def _run(name, cache_dir):
    return run(CASES[name](cache_dir))


def test_every_state_and_force_is_what_was_recorded(both):
    name, record, today = both
    if machine() == record.machine:
        tick = first_difference(today, record.run)
        assert tick is None, f"{name} differs from tick {tick} on: {_what_differs(today, record.run, tick)}"
    else:
        apart = deviations(today, record.run)
        assert all(apart[key] <= TOLERANCE[name][key] for key in apart), apart


def _what_differs(today, recorded, tick):
    """The quantities that are more than a quantum off in the first tick that differs."""
    rows = {}
    for key, values in recorded.values.items():
        if key in RAGGED:
            rows[f"rows of {key}"] = int(today.counts[key][tick]), int(recorded.counts[key][tick])
        else:
            rows[key] = float(np.abs(np.subtract(today.values[key][tick], values[tick])).max())
    return rows


@pytest.mark.parametrize("name", CASES)
def test_the_recorded_runs_go_through_what_they_are_for(name):
    """A run in which nothing touches would prove nothing."""
    run = stored.load(name).run
    touching = run.counts["contact_force_n"] > 0
    assert touching.mean() > 0.3
    assert (np.abs(run.values["tool_force_n"]).max(axis=(0, 2)) > 5e-3).all(), "both tools feel the scene"
    if name == "insertion":
        assert run.values["inserted_m"].max() > 20e-3
        assert np.ptp(run.values["stone_m"][:, 0], axis=0).max() > 0.5e-3
    if name == "pinch":
        assert np.abs(run.values["grasp_torque_nm"]).max(axis=0).min() > 4e-3, "what the wall pushes, and nothing else"


def test_a_change_of_the_last_bit_is_noticed(tmp_path):
    record = stored.load("pinch")
    changed = record.run.checksum.copy()
    changed[1234] ^= np.uint64(1)
    other = type(record.run)(changed, record.run.values, record.run.counts)
    assert first_difference(other, record.run) == 1234
