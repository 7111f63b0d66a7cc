"""What the study of sleeping parts times and compares, counted: the same on every machine."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import SMALLEST

from tests.instructions import instructions
from trocar.services.mechanics.bodies import catheter as catheter_body
from trocar.services.mechanics.bodies.catheter import CatheterBody
from trocar.services.mechanics.simulation import duct_alone
from trocar.studies.accuracy.study import Setting
from trocar.studies.accuracy.sweeps import sleeping

SETTINGS = {setting.name: setting for setting in sleeping.settings(SMALLEST)}
BODIES = [setting for setting in SETTINGS.values() if setting.choices["sleeping"]]


def awake(setting: Setting) -> Setting:
    return SETTINGS[setting.name.replace("asleep", "kept awake")]


@pytest.mark.parametrize("setting", BODIES, ids=lambda each: each.name)
def test_what_is_timed_asleep_is_one_question_and_less_than_half_of_what_is_timed_awake(setting):
    ticks = [sleeping.tick(each, SMALLEST) for each in (setting, awake(setting))]
    for tick in ticks * 3:  # what is not compiled yet is no part of a tick
        tick()
    asleep, kept_awake = map(instructions, ticks)
    assert asleep < 70
    assert 2 * asleep < kept_awake


def test_what_is_woken_goes_where_it_would_have_gone(run_smallest):
    rows, _ = run_smallest("sleeping", costs=False)
    worst = {row.quantity: max(r.error for r in rows if r.quantity == row.quantity) for row in rows}
    assert worst[sleeping.JUMP] <= worst[sleeping.COURSE] < 0.1  # um
    assert worst[sleeping.FORCE] < 1.0  # uN
    reference = sleeping.reference(SMALLEST)
    for body in ("duct alone", "catheter"):
        places = reference[f"{body}: places"]
        assert np.linalg.norm(places - places[0], axis=2).max() > 1e-6, "it has been woken"
    assert np.linalg.norm(reference["catheter: forces"], axis=1).max() > 1e-5


def test_a_part_that_sleeps_on_though_it_is_struck_or_touched_is_seen(monkeypatch):
    monkeypatch.setattr(duct_alone, "is_at_rest", lambda *_: True)
    monkeypatch.setattr(catheter_body, "continue_sleep", lambda *_: True)
    monkeypatch.setattr(CatheterBody, "_may_sleep_now", property(lambda body: body._may_sleep))
    reference = sleeping.reference(SMALLEST)
    for setting in BODIES:
        found = sleeping.errors(setting, reference, SMALLEST)
        assert found[sleeping.COURSE].value > 0.1
