from __future__ import annotations

import itertools
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.cli.conftest import Trocar
from trocar.services.mechanics.effects import EFFECTS, EffectEntry
from trocar.studies import effect_costs
from trocar.studies.commands import progress_bar

SMALL = Path(__file__).parents[1] / "scenes" / "small.yaml"


def test_every_row_of_the_table_is_listed_with_its_settings(trocar: Trocar) -> None:
    ran = trocar("effects", "--scene", SMALL, "--json")
    told = json.loads(ran.out)
    assert ran.code == 0
    assert [line["name"] for line in told["effects"]] == list(EFFECTS)
    lines = {line["name"]: line for line in told["effects"]}
    assert lines["friction"]["in_scene"]
    assert not lines["twist"]["in_scene"]
    assert lines["mucus_drag"]["settings"]["viscosity_pa_s"] == 0.5
    assert lines["friction"]["law"].startswith("Stick below mu_static")
    assert all(line["what"] and line["cost"] is None for line in told["effects"])


def test_people_read_what_an_effect_is_and_needs(trocar: Trocar, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    ran = trocar("effects", "--scene", SMALL)
    assert "viscosity_pa_s = 0.5" in ran.out
    assert "--measure" in ran.out


@contextmanager
def only(rows: dict[str, EffectEntry]) -> Iterator[None]:
    """Let the table of effects be `rows`. Its order is that in which effects act: it is put back as it was."""
    whole = dict(EFFECTS)
    EFFECTS.clear()
    EFFECTS.update(rows)
    try:
        yield
    finally:
        EFFECTS.clear()
        EFFECTS.update(whole)


def test_costs_are_measured_by_running_the_scene(
    trocar: Trocar, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """An effect that takes a millisecond of the clock costs that, and one that takes none nothing."""
    now_ns = itertools.count(step=1000)
    late_ns: list[int] = []

    def waste(*_: object) -> None:
        late_ns.append(1_000_000)

    wasteful = type("Wasteful", (EFFECTS["grasp_slip"].kind,), {"add_loads": waste})
    row = type(EFFECTS["grasp_slip"])(wasteful, "wastes a millisecond")
    last = list(EFFECTS)[-1]
    with only({last: EFFECTS[last], "wasteful": row}):
        _measure(trocar, monkeypatch, tmp_path, now_ns, late_ns)


def _measure(
    trocar: Trocar, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, now_ns: Iterator[int], late_ns: list[int]
) -> None:
    monkeypatch.setattr(effect_costs, "perf_counter_ns", lambda: next(now_ns) + sum(late_ns))
    monkeypatch.setattr(effect_costs, "START_TICK", 10)
    monkeypatch.setattr(effect_costs, "N_TICKS", 20)
    scene = tmp_path / "scene.yaml"
    scene.write_text(SMALL.read_text().replace("effects: {gravity: {}, friction: {}}", "effects: {grasp_slip: {}}"))
    monkeypatch.setattr(progress_bar, "EVERY_S", 1e-3)
    ran = trocar("effects", "--scene", scene, "--measure", "--json")
    assert ran.code == 0, ran.err
    assert "measuring wasteful: 1 of 2" in ran.err, "in a pipe, too, it says how far it is"
    costs = {line["name"]: line["cost"] for line in json.loads(ran.out)["effects"]}
    assert costs["wasteful"] == pytest.approx({"extra_us": 1000.0, "noise_us": 0.0, "step_us": 1.0})
    assert costs["grasp_slip"] == pytest.approx({"extra_us": 0.0, "noise_us": 0.0, "step_us": 1.0})
    assert len(late_ns) == 10 + 20


def test_a_scene_that_is_not_there_is_a_sentence(trocar: Trocar) -> None:
    ran = trocar("effects", "--scene", "nowhere")
    assert ran.code == 2
    assert "nowhere" in ran.sentence()
