"""What is felt: the servo's law against theory, and hands that try to get energy out of it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from trocar.protocol.arrays import pack
from trocar.protocol.bodies import (
    Catheter,
    ContactForces,
    Duct,
    GatewayState,
    InstrumentState,
    PhysicsState,
    ToolReaction,
)
from trocar.protocol.bodies.physics import reaction_table
from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.bodies.forceps.kinematics import jaw_angle_from_handle
from trocar.services.mechanics.reduction import ReducedDuct
from trocar.services.mechanics.scenarios import insertion
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct
from trocar.services.runtime.errors import ConfigError, UserError
from trocar.studies.commands.haptics import Request, read_running, run_haptics
from trocar.studies.feel import measure
from trocar.studies.feel.compare import Compared
from trocar.studies.feel.hands import attack_servo, random_attack
from trocar.studies.feel.hunt import Hunted
from trocar.studies.feel.late import TICK_S, TOOLS, Late, Solved, answer_late, newest_answer
from trocar.studies.feel.report import Felt, write_page
from trocar.studies.feel.slow_hands import Slow
from trocar.studies.feel.tracking import Apart, Pinched, Running, compare, find_pinch
from trocar.studies.feel.virtual_wall import (
    VirtualWall,
    measured_passive_friction,
    measured_stable_stiffness,
    passive_friction,
    response,
    stable_stiffness,
)


@pytest.mark.parametrize(
    "wall",
    [
        VirtualWall(300.0),
        VirtualWall(2000.0, 0.4),
        VirtualWall(800.0, 0.3, period_s=2e-3),
        VirtualWall(500.0, delay=1),
        VirtualWall(500.0, delay=7),
        VirtualWall(150.0, period_s=0.5e-3, delay=20),
    ],
    ids=str,
)
def test_a_wall_is_passive_from_the_friction_of_colgate_and_schenkel(wall: VirtualWall) -> None:
    assert measured_passive_friction(wall) == pytest.approx(passive_friction(wall), rel=0.01)


@pytest.mark.parametrize(
    "wall",
    [
        VirtualWall(1.0, friction_n_s_m=0.05),
        VirtualWall(1.0, friction_n_s_m=0.1, period_s=4e-3),
        VirtualWall(1.0, 0.3, friction_n_s_m=0.2),
        VirtualWall(1.0, friction_n_s_m=0.5, delay=10),
        VirtualWall(1.0, friction_n_s_m=0.1, delay=100),
    ],
    ids=str,
)
def test_a_device_is_stable_at_a_wall_up_to_the_stiffness_that_theory_gives(wall: VirtualWall) -> None:
    assert measured_stable_stiffness(wall) == pytest.approx(stable_stiffness(wall), rel=0.05)


@pytest.mark.parametrize("hertz", [1.0, 20.0, 100.0])
@pytest.mark.parametrize("delay", [None, 1, 13])
def test_a_moving_hand_meets_the_stiffness_behind_hold_and_delay(hertz: float, delay: int | None) -> None:
    """A zero-order hold is sinc(fT) and half a period late; a force over the bus is its delay later still."""
    wall = VirtualWall(500.0)
    found = response(wall, hertz, delay)
    half = math.pi * hertz * wall.period_s
    assert abs(found) == pytest.approx(500.0 * math.sin(half) / half, rel=1e-3)
    row = measure.Rendered("", (0.5 + (delay or 0)) * 1e-3, hertz, found)
    assert row.late_deg == pytest.approx(360.0 * hertz * row.lag_s, abs=0.1)


def test_no_hand_gets_energy_out_and_without_bound_and_local_model_some_do() -> None:
    seeds = (10, 31, 40)
    # Of the others each got energy out when only the damping answered for it: that comes late, as the force does.
    late = (268, 145, 559, 678, 179)
    assert max(attack_servo(random_attack(seed)).gained_j for seed in (*seeds, *late)) <= 0.0
    bare = [attack_servo(random_attack(seed, local=False, bounded=False)).gained_j for seed in seeds]
    assert max(bare) > 0.1


def test_the_page_tells_what_was_found(tmp_path: Path) -> None:
    border = measure.Border(VirtualWall(500.0), 0.25, 0.26)
    books = tuple(attack_servo(random_attack(seed), ticks=100) for seed in (0, 1))
    found = measure.Energies("local model, bounded", (random_attack(0), random_attack(1)), books)
    rendered = [measure.Rendered(name, 5e-4, 1.0, 500.0 + 0j) for name, _ in measure.WAYS]
    late = [Late(tool, 5, 0, np.array([0.01, 0.2]), np.array([0.5, 0.01])) for tool in TOOLS]
    apart = Apart("wall", "applied by the arm", 0.951, 0.234)
    running = Running(3500, 7, (apart,), Pinched(10.4e-3, -0.0046, 0.012), ("on a machine",))
    hunted, slow = [Hunted("touch", True, 960, 0, -1e-6)], [Slow("touch", (50.0, 600.0), 0.019, 0.017)]
    compared = [Compared("a spring alone", "touch", 316.0, 319.4, 2.0, 0.0, 0.154)]
    felt = Felt([border], [border], rendered, [found], late, hunted, slow, running, compared)
    write_page(felt, ["made so"], tmp_path / "felt", tmp_path / "felt.md")
    page = (tmp_path / "felt.md").read_text(encoding="utf-8")
    assert "theory is **4.0 %**" in " ".join(page.split())
    assert f"|local model, bounded|**{found.gaining}** of 2|" in page
    assert "|5|50.0%, 20.0%|50.0%, 50.0%|50.0%, 20.0%|50.0%, 50.0%|" in page
    assert "|wall, applied by the arm|95.1%|23.4%|" in page
    assert "by **-0.5 %** from that of the rig's wall" in " ".join(page.split())
    assert "- 3,500 ticks, 7 of them lost" in page
    assert "|touch|yes|960|0|nothing|" in page
    assert "|touch|1.9% (1.7%)|" in page
    assert "|a spring alone|316 (319)|2|0|15%|" in page
    assert max(map(len, page.splitlines())) <= 120
    write_page(replace(felt, running=None), [], tmp_path / "felt", tmp_path / "felt.md")
    assert "Not measured: `trocar haptics --running`" in (tmp_path / "felt.md").read_text(encoding="utf-8")


def test_what_running_processes_did_is_kept_and_a_file_that_is_not_ours_is_one_sentence(tmp_path: Path) -> None:
    kept = tmp_path / "running.json"
    assert read_running(kept) is None
    running = Running(3500, 7, (Apart("wall", "solved by physics", 0.9, 0.1),), Pinched(1e-2, 0.0, 0.0), ("so",))
    kept.write_bytes(msgspec.json.encode(running))
    assert read_running(kept) == running
    kept.write_text('{"ticks": "many"}')
    with pytest.raises(UserError, match=r"running\.json: .*ticks"):
        read_running(kept)


def _frames(duct: ReducedDuct, ticks: int, lost: tuple[int, ...]) -> tuple[list[GatewayState], list[PhysicsState]]:
    """Return what a rig would say of an insertion that applies after two ticks exactly what is solved."""
    scenario = insertion()
    simulation, tools, steps = Simulation(scenario.scene, duct), ToolInputs(), 1
    said: list[GatewayState] = []
    solved: list[PhysicsState] = []
    for tick in range(1, ticks + 1):
        if tick in lost:
            steps += 1
            continue
        scenario.write_inputs(1e-3 * tick, tools)
        due = next((body.reactions() for body in solved[-3:] if body.tick == tick - 2), (ToolReaction(),) * 2)
        instruments = []
        for i, jaws in enumerate(each.jaws for each in scenario.scene.forceps):
            assert jaws is not None
            handle_rad = float(tools.jaw_angle_rad[i]) / jaws.jaw_ratio
            tools.jaw_angle_rad[i] = jaw_angle_from_handle(handle_rad, jaws.jaw_ratio, jaws.jaw_max_angle_rad)
            instruments.append(
                InstrumentState(
                    name=f"tool {i}",
                    position_m=tuple(tools.position_m[i].tolist()),
                    roll_rad=float(tools.roll_rad[i]),
                    handle_angle_rad=handle_rad,
                    applied_force_n=due[i].force_n,
                )
            )
        said.append(GatewayState(tick=tick, instruments=tuple(instruments)))
        for _ in range(steps):
            simulation.step(tools)
        steps = 1
        solved.append(_state(simulation, tick))
    return said, solved


def _state(simulation: Simulation, tick: int) -> PhysicsState:
    duct, n = simulation.duct, simulation.duct.n_loads
    reactions = [ToolReaction(force_n=tuple(force)) for force in simulation.tool_results.force_n.tolist()]
    nothing = np.zeros((0, 3))
    return PhysicsState(
        tick=tick,
        tools=reaction_table(reactions),
        duct=Duct(
            basis_hash="",
            q=pack(duct.state.q.copy()),
            q_rate=pack(duct.state.qdot.copy()),
            load_node=pack(duct.load_nodes[:n].copy(), "<i4"),
            load_force_n=pack(duct.load_force_n[:n].copy()),
        ),
        catheter=Catheter(position_m=pack(nothing), velocity_m_s=pack(nothing), radius_m=1e-3),
        contacts=ContactForces(kind=pack(np.zeros(0, np.int8), "|i1"), point_m=pack(nothing), force_n=pack(nothing)),
    )


def test_two_runs_of_the_mechanics_are_one_another_and_a_force_that_is_off_is_told() -> None:
    """Frames of a rig that solves as the mechanics alone do, with one tick lost and one force of the arm doubled."""
    duct = build_scene_duct(insertion().scene, cache_directory() / "bases")
    said, solved = _frames(duct, ticks=700, lost=(300,))
    spoiled = said[400].instruments[1]
    instruments = said[400].instruments[0], msgspec.structs.replace(spoiled, applied_force_n=(9.0, 0.0, 0.0))
    said[400] = msgspec.structs.replace(said[400], instruments=instruments)
    tracked = compare(said, solved, (insertion().scene, duct))
    assert tracked.lost == 1
    assert tracked.solved.max() == 0.0
    wall = tracked.apart()[3]
    assert (wall.tool, wall.what) == ("wall", "applied by the arm")
    assert wall.worst > 100.0
    pinch = find_pinch(said, solved, (insertion().scene, duct))
    assert abs(pinch.wall) < 0.02
    assert pinch.applied < 0.1
    assert pinch.force_n > 5e-3


def test_answers_come_as_late_as_is_added_and_the_newest_counts() -> None:
    assert newest_answer(6, 0, 0, np.random.default_rng(0)).tolist()[1:] == [0, 1, 2, 3, 4]
    assert newest_answer(6, 2, 0, np.random.default_rng(0)).tolist()[3:] == [0, 1, 2]
    newest = newest_answer(2000, 3, 10, np.random.default_rng(1))
    ages = np.arange(2000)[50:] - newest[50:]
    assert (ages.min(), np.diff(newest).min()) == (4, 0)
    assert 4 < ages.mean() < 9, "an answer that overtakes others counts"


def test_a_local_model_that_is_late_follows_a_wall_and_a_force_alone_is_where_it_was() -> None:
    """A hand that moves evenly in a spring: exact at 5 ms, and nothing beyond the life of a model."""
    n, stiffness = 400, 100.0
    places = np.zeros((n, 2, 3))
    places[:, :, 2] = -1e-5 * np.arange(n)[:, None]
    K = np.tile(np.diag([0.0, 0.0, stiffness]).ravel(), (n, 2, 1))
    solved = Solved(places, np.diff(places, axis=0, prepend=places[:1]) / TICK_S, -stiffness * places, K)
    at_5, at_50 = (answer_late(solved, [(ms, 0)])[0] for ms in (4, 50))
    assert at_5.local[100:].max() < 1e-3
    np.testing.assert_allclose(at_5.force_alone[100:], 5.0 / (n - 1))
    np.testing.assert_allclose(at_50.local[100:], np.arange(n)[100:] / (n - 1))
    np.testing.assert_allclose(at_50.force_alone[100:], 51.0 / (n - 1))


def test_a_page_in_a_folder_that_cannot_be_is_refused_before_anything_is_measured(tmp_path: Path) -> None:
    (tmp_path / "nowhere").touch()
    with pytest.raises(ConfigError, match=r"--out .*/nowhere: is a file, not a folder"):
        run_haptics(Request(1, tmp_path / "nowhere" / "felt.md", json=False))
