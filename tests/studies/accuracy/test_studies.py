"""Every study on its smallest size: what has to be seen in it, whatever the machine."""

import math
from dataclasses import replace
from itertools import combinations

import pytest
from conftest import SMALLEST

from trocar.services.mechanics.effects import EFFECTS
from trocar.services.mechanics.scenarios import insertion_scene
from trocar.services.scenes import load_scene
from trocar.studies.accuracy import pinches
from trocar.studies.accuracy.frontier import frontier
from trocar.studies.accuracy.report import findings_of
from trocar.studies.accuracy.study import Cost, Draw, Row, Size, load_study, study_names
from trocar.studies.accuracy.sweeps import default as study_default
from trocar.studies.accuracy.sweeps import mesh, paper

WANTED = {
    "modes",
    "mesh",
    "element",
    "integrator",
    "timestep",
    "catheter",
    "contact",
    "effects",
    "paper",
    "softening",
    "default",
    "sleeping",
}


def errors_of(rows, quantity):
    return {row.setting: row.error for row in rows if row.quantity == quantity}


def test_a_study_is_found_by_the_name_of_its_file():
    assert set(study_names()) >= WANTED
    with pytest.raises(ValueError, match=r"no study 'nodes'; known: .*modes"):
        load_study("nodes")


#: By day the studies that are cheapest and furthest apart; each one in the long run.
BY_DAY = {"catheter", "contact", "element"}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.long] * (name not in BY_DAY)) for name in sorted(WANTED)]
)
def test_settings_have_names_of_their_own_and_every_one_has_an_error_and_a_cost(name, run_smallest):
    settings = load_study(name).settings(SMALLEST)
    assert len({setting.name for setting in settings}) == len(settings) > 1
    rows, _ = run_smallest(name)
    assert {row.setting for row in rows} == {setting.name for setting in settings}
    for row in rows:
        assert math.isfinite(row.error), row
        assert row.cost is not None, row
        assert 0.0 < row.cost.median_us <= row.cost.p99_us
    assert all(line.endswith(".") for line in findings_of(name, rows))


def test_the_residual_makes_a_pinch_exact_at_any_number_of_modes_and_bare_modes_are_too_stiff(run_smallest):
    rows, _ = run_smallest("modes", costs=False)
    pinch = errors_of(rows, "force at the tool, pinch")
    assert max(pinch["10 modes, residual"], pinch["40 modes, residual"]) < 1e-4
    assert pinch["10 modes, bare"] > pinch["40 modes, bare"] > 10.0


def test_frequencies_converge_with_the_mesh(run_smallest):
    rows, _ = run_smallest("mesh", costs=False)
    frequency = list(errors_of(rows, "frequency").values())
    assert frequency[0] > 1.5 * frequency[1] > 0.0


def test_a_wall_that_gives_way_is_nearer_to_the_shell_than_a_linear_one(run_smallest):
    rows, _ = run_smallest("softening", costs=False)
    median = errors_of(rows, "force, median load")
    assert median["linear"] > 15.0
    assert median["4 squeezes"] < 0.5 * median["linear"]


def test_the_papers_triangle_is_stiffer_in_bending_than_ours(run_smallest):
    rows, _ = run_smallest("element", costs=False)
    pinch = errors_of(rows, "force at the tool, pinch")
    assert pinch["andes, tocher, 12 x 16"] != pinch["andes, dkt, 12 x 16"]


@pytest.mark.parametrize("size", [Size.QUICK, Size.FULL])
def test_all_effects_and_all_pairs_are_tried_and_timed_in_turns(size):
    settings = load_study("effects").settings(Draw(size, 1))
    pairs = {f"{one} {other}" for one, other in combinations(EFFECTS, 2)}
    assert {setting.choices["changed"] for setting in settings} == {"", *EFFECTS, *pairs}
    assert len({setting.group for setting in settings}) == 1, "all beside what they are compared with"
    assert len(pairs) > 60


def test_the_rule_for_cells_is_among_the_meshes_and_finer_than_all_but_the_references():
    quick = load_study("mesh").settings(Draw(Size.QUICK, 1))
    cells = {setting.name: setting.choices["duct.n_around"] * setting.choices["duct.n_along"] for setting in quick}
    assert max(cells, key=cells.get).startswith("auto, ")


def test_the_limit_of_a_pinch_is_beyond_the_finest_mesh_that_leads_to_it():
    duct = insertion_scene().duct
    limit, coarse, fine = (
        each["pinch_m"][0]
        for each in (
            mesh.limit_figures(duct, SMALLEST),
            *(mesh.full_figures(replace(duct, n_around=n, n_along=m)) for n, m in ((16, 20), (24, 30))),
        )
    )
    assert limit > fine > coarse
    finer = mesh.full_figures(replace(duct, n_around=40, n_along=52))["pinch_m"][0]
    assert limit / finer == pytest.approx(1.0, abs=0.03)


def test_the_default_scene_is_itself_and_each_choice_is_made():
    default = load_scene("default")
    scenes = {
        setting.name: study_default.scene_of(setting.choices, Draw(Size.FULL, 1))
        for setting in study_default.settings(Draw(Size.FULL, 1))
    }
    assert replace(scenes[study_default.AS_IT_IS], duct=replace(default.duct)) == default
    assert len({repr(scene) for name, scene in scenes.items() if "steps" not in name}) == len(scenes) - 1


def test_a_wider_duct_is_no_choice_and_has_no_place_on_the_frontier(run_smallest):
    rows, _ = run_smallest("default", costs=False)
    cost = Cost(100.0, 120.0, 1.0)
    best = frontier([replace(row, cost=cost) for row in rows if row.quantity == study_default.WALL])
    assert [row.setting for row in best] == [study_default.AS_IT_IS]
    assert {row.setting for row in rows} == {study_default.AS_IT_IS, study_default.WIDER}


def test_the_papers_set_up_is_told_beside_the_best_of_ours_that_takes_no_longer():
    def row(setting, error, us):
        return Row("paper", setting, "set-ups", pinches.FORCE, error, "%", cost=Cost(us, us, 1.0))

    def told(*rows):
        return [line for line in paper.findings([row("paper", 20.0, 900.0), *rows]) if "At no more" in line]

    (line,) = told(row("ours", 3.0, 800.0), row("ours, small", 9.0, 300.0), row("ours, dear", 1.0, 901.0))
    assert "paper's 900 us a tick: force at the tool, pinch 20 % by the paper's, 3 % by 'ours' (800 us)." in line
    assert told(row("ours, dear", 1.0, 901.0)) == []


def test_what_is_changed_by_nothing_is_nothing(run_smallest):
    rows, _ = run_smallest("effects", costs=False)
    unchanged = [row.error for row in rows if row.setting == "unchanged"]
    assert unchanged == [0.0] * 4
    assert not any(row.is_known for row in rows)


def test_operations_of_a_full_matrix_grow_by_the_square_and_those_of_modes_by_n(run_smallest):
    rows, _ = run_smallest("paper", costs=False)
    counts = errors_of(rows, paper.OPERATIONS)

    def growth(way):
        small, large = (counts[f"{way}, n = {n}"] for n in (240, 576))
        return math.log(large / small) / math.log(576 / 240)

    assert growth(paper.DENSE) == pytest.approx(2.0, abs=0.05)
    assert growth(paper.ALL_NODES) == pytest.approx(1.0, abs=0.05)
    assert growth(paper.TOUCHED) == 0.0
    assert 1.0 < growth(paper.SPARSE) < 1.6
    # Appendix B's own sums, by hand for n = 240.
    assert counts[f"{paper.DENSE}, n = 240"] == 27 * 240 + 4 * 240**2
    assert counts[f"{paper.ALL_NODES}, n = 240"] == 27 * 60 + 4 * 240 * 60


def test_a_triangle_that_is_for_comparison_only_is_told_but_no_choice(run_smallest):
    rows, _ = run_smallest("element", costs=False)
    assert {row.setting for row in rows if not row.is_known} == {"cst, tocher, 12 x 16", "andes, tocher, 12 x 16"}
