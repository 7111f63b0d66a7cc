"""Appendix B of the paper as n grows, and the paper's whole set-up beside ours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem import ShellModel
from trocar.services.mechanics.reduction import ModalState, Newmark
from trocar.services.mechanics.scenarios import insertion_scene
from trocar.services.mechanics.scene import DuctScene, SceneModel
from trocar.studies.accuracy import insertions, pinches
from trocar.studies.accuracy.growth import draw_growth, growth_exponents
from trocar.studies.accuracy.report import costs_us, number, values
from trocar.studies.accuracy.study import Choice, Draw, Error, Reference, Row, Setting, Tick
from trocar.studies.full_model import CondensedStiffness, DirectNewmark
from trocar.studies.paper_scene import paper_scene

TITLE = "The paper: its count of operations, and its set-up beside ours"
WHAT = (
    "First table, after Appendix B of Basdogan, Ho and Srinivasan (2001): operations and time of one step as the mesh "
    "grows. Direct integration (the paper's DNIOS) has a full matrix, as in the paper, or a sparse one. 60 modes (its "
    "NIRMS) give displacements of all nodes, as in the paper, or only of touched nodes. Second table: the paper's "
    "whole set-up (element, bare modes, particles, penalty contact), ours, and steps between the two. The reference is"
    " our insertion on a finer mesh, with more modes, particles and steps."
)
OPERATIONS = "operations a step"
R = 60
DENSE, SPARSE, ALL_NODES, TOUCHED = (
    "direct, full matrix",
    "direct, sparse",
    "60 modes, all nodes",
    "60 modes, touched nodes",
)
N_TOUCHED = 30
_STEP_S, _EVERY_S = 2.5e-4, 1e-3
_JUDGED = ((pinches.FORCE, "%"), (pinches.MOTION, "%"), (insertions.FORCE, "%"), (insertions.TIP, "mm"))


def settings(draw: Draw) -> Sequence[Setting]:
    """The growing meshes, then the set-ups."""
    meshes = draw.pick(
        ((8, 10), (12, 16)),
        ((8, 10), (12, 16), (16, 20), (24, 32)),
        ((8, 10), (12, 16), (16, 20), (20, 26), (24, 32), (32, 42), (48, 64)),
    )
    largest_dense = draw.pick(12, 16, 24)
    growing = [
        _growing(way, around, along)
        for way in (DENSE, SPARSE, ALL_NODES, TOUCHED)
        for around, along in meshes
        if way != DENSE or around <= largest_dense
    ]
    return [*growing, *(Setting(name, {"set-up": name}, "set-ups") for name in _setups(draw))]


def _growing(way: str, around: int, along: int) -> Setting:
    name = f"{way}, n = {3 * around * along}"
    choices: dict[str, Choice] = {"way": way, "n": 3 * around * along, "duct.n_around": around, "duct.n_along": along}
    return Setting(name, choices, way, group=name)


def _setups(draw: Draw) -> dict[str, SceneModel]:
    """Return the paper's scene, ours, and what is between."""
    paper, ours = paper_scene(), insertion_scene()
    small = replace(ours.duct, n_around=12, n_along=16, n_modes=20)
    every = {
        "paper": paper,
        "paper, our triangles": replace(paper, duct=replace(paper.duct, membrane="andes", bending="dkt")),
        "paper, our residual": replace(paper, duct=replace(paper.duct, residual="auto")),
        "paper, our duct": replace(paper, duct=ours.duct),
        "paper, our contact": replace(paper, contact=ours.contact),
        "paper, our friction": replace(
            paper, effects=ours.effects, catheter=replace(paper.catheter, introducer_seal_friction_n=20e-3)
        ),
        "ours": ours,
        "ours, small": replace(ours, duct=small, catheter=replace(ours.catheter, n_segments=30)),
        "ours without friction, as the paper": replace(
            ours, effects=paper.effects, catheter=replace(ours.catheter, introducer_seal_friction_n=0.0)
        ),
    }
    names = draw.pick(["paper", "ours"], list(every), list(every))
    return {name: every[name] for name in names}


def reference(draw: Draw) -> Reference:
    """Return the finest model's pinch and motion, and the finest insertion."""
    scene = insertion_scene()
    finest = _on_mesh(scene.duct, draw.pick((20, 26), (40, 52), (64, 84)))
    model = pinches.full_model(finest)
    pinch = pinches.Pinch.of(model.mesh, finest)
    moved_m = model.solve_static(pinch.load_n(model.mesh.n_vertices)).displacement_m
    duct = _on_mesh(scene.duct, draw.pick((12, 16), (24, 32), (32, 42)))
    duct = replace(duct, n_modes=draw.pick(40, 120, 160))
    catheter = replace(scene.catheter, n_segments=draw.pick(50, 80, 100))
    running = replace(scene, duct=duct, catheter=catheter)
    return {
        "pinch_m": np.array([pinch.closing_m(moved_m)]),
        "closing_m": pinches.full_motion_m(model, pinch, _STEP_S, _EVERY_S),
        **insertions.insertion_reference(running, draw, draw.pick(1e-3, 5e-4, 2.5e-4)),
    }


def _on_mesh(duct: DuctScene, cells: tuple[int, int]) -> DuctScene:
    return replace(duct, n_around=cells[0], n_along=cells[1])


def errors(setting: Setting, reference: Reference, draw: Draw) -> dict[str, Error]:
    """Operations of a growing mesh; pinch, motion and insertion of a set-up."""
    if "way" in setting.choices:
        return {OPERATIONS: Error(float(_operations(setting)), "operations", is_known=False)}
    scene = _setups(draw)[str(setting.choices["set-up"])]
    duct = pinches.reduced(scene.duct)
    pinch = pinches.Pinch.of(duct.mesh, scene.duct)
    motion_m = pinches.modal_motion_m(duct, pinch, insertions.TICK_S, _EVERY_S, is_exact=False)
    return {
        **pinches.static_errors(duct, pinch, float(reference["pinch_m"][0]), None),
        pinches.MOTION: pinches.motion_error(motion_m, reference["closing_m"]),
        **insertions.insertion_errors(scene, reference, draw),
    }


def _operations(setting: Setting) -> int:
    """Return the count of Appendix B: a product and a sum are one each.

    Steps 1 and 3 as printed. Step 2 is two triangular solves, 2 entries of the factor each; step 4 a product with K.
    The paper leaves both at n^2; sparse, they are what is stored. Its 2 n r twice is the way from modes to nodes and
    from modal forces to nodal ones, which a contact asks for at the touched nodes only.
    """
    way, model = str(setting.choices["way"]), _model(setting)
    n = model.free_translations.size
    if way == DENSE:
        return 7 * n + 2 * n * n + 16 * n + 2 * n * n + 4 * n
    if way == SPARSE:
        d = len(model.free_dofs)
        factor = model.factor
        return 7 * d + 2 * (factor.L.nnz + factor.U.nnz) + 16 * d + 2 * model.K_free.nnz + 4 * d
    rows = n if way == ALL_NODES else 3 * N_TOUCHED
    return 27 * R + 2 * (2 * rows * R)


def _model(setting: Setting) -> ShellModel:
    choices = setting.choices
    duct = replace(insertion_scene().duct, n_around=int(choices["duct.n_around"]), n_along=int(choices["duct.n_along"]))
    return pinches.full_model(duct)


def tick(setting: Setting, draw: Draw) -> Tick:
    """A step of the growing mesh; a tick of the insertion of a set-up."""
    if "way" not in setting.choices:
        return insertions.insertion_tick(_setups(draw)[str(setting.choices["set-up"])], draw)
    way, model = str(setting.choices["way"]), _model(setting)
    if way == DENSE:
        return _dense_tick(model)
    if way == SPARSE:
        return _sparse_tick(model)
    return _modal_tick(model.free_translations.size if way == ALL_NODES else 3 * N_TOUCHED)


def _sparse_tick(model: ShellModel) -> Tick:
    direct = DirectNewmark(model, insertions.TICK_S, 20.0)
    load = np.zeros((model.mesh.n_vertices, 3))
    load[-1] = 0.0, 0.0, 1e-2

    def step() -> None:
        direct.step(load)
        direct.reaction_force()

    return step


def _dense_tick(model: ShellModel) -> Tick:
    """Condensed to translations and stored in full, as the paper has it."""
    condensed = CondensedStiffness(model)
    n = condensed.translations.size
    K: FloatArray = np.column_stack([condensed.apply(unit) for unit in np.eye(n)])
    mass = model.free_mass_kg[condensed.translations]
    dt = insertions.TICK_S
    factor = cho_factor(0.5 * (K + K.T) + np.diag(4.0 / dt**2 * mass), lower=True)
    u, v, a = np.zeros((3, n))
    load = np.zeros(n)
    load[-1] = 1e-2

    def step() -> None:
        moved = cho_solve(factor, load + mass * (4.0 / dt**2 * u + 4.0 / dt * v + a), check_finite=False)
        end = 4.0 / dt**2 * (moved - u) - 4.0 / dt * v - a
        v[:] += 0.5 * dt * (a + end)
        u[:], a[:] = moved, end
        _ = mass * a + K @ u

    return step


def _modal_tick(n_rows: int) -> Tick:
    """Numbers of the right shape: what a step costs does not depend on their values."""
    random = np.random.default_rng(0)
    omega = np.sort(random.uniform(50.0, 2000.0, R))
    integrator, state = Newmark(omega, np.full(R, 0.1)), ModalState.at_rest(R)
    rows, force = random.standard_normal((n_rows, R)), np.ones(R)
    moved, forces = np.zeros((2, n_rows))

    def step() -> None:
        integrator.predict(state, force, insertions.TICK_S)
        np.dot(rows, state.q, out=moved)
        np.dot(rows, state.qddot + omega**2 * state.q, out=forces)

    return step


def draw_figure(rows: Sequence[Row], stem: Path) -> list[Path]:
    """Draw what grows over n, beside the frontier of the set-ups."""
    growing = [row for row in rows if row.quantity == OPERATIONS]
    return draw_growth(TITLE, growing, [row for row in rows if row.quantity != OPERATIONS], stem)


def findings(rows: Sequence[Row]) -> list[str]:
    """Say how operations and time grow, and what the whole set-up comes to."""
    growing, cost = [row for row in rows if row.quantity == OPERATIONS], costs_us(rows)
    counts = growth_exponents(growing, {id(row): row.error for row in growing})
    times = growth_exponents(growing, {id(row): row.cost.median_us for row in growing if row.cost is not None})
    told = [
        f"{way}: operations as n^{exponent:.2f}" + (f", time as n^{times[way]:.2f}" if way in times else "")
        for way, exponent in counts.items()
    ]
    lines = [
        f"Growth between the two largest meshes: {'; '.join(told)}.",
        "The paper states n^2 for direct integration and n log n for modes. A full matrix gives n^2; the matrix is "
        "sparse, and a sparse solver grows more slowly. r modes take 4 n r + 27 r operations, which is linear in n and "
        "needs no logarithm; for touched nodes alone the count does not grow at all.",
    ]
    return [*lines, *_at_equal_cost(rows, cost)] if "paper" in cost else lines


def _at_equal_cost(rows: Sequence[Row], cost: Mapping[str, float]) -> list[str]:
    """Say what of ours, for no more time than the paper's set-up takes, is how far off."""
    told = []
    for quantity, unit in _JUDGED:
        error = values(rows, quantity)
        ours = [name for name in error if name.startswith("ours") and cost.get(name, np.inf) <= cost["paper"]]
        if ours and "paper" in error:
            best = min(ours, key=lambda name: error[name])
            told.append(
                f"{quantity} {number(error['paper'])} {unit} by the paper's, {number(error[best])} {unit} by {best!r} "
                f"({cost[best]:.0f} us)"
            )
    return [f"At no more than the paper's {cost['paper']:.0f} us a tick: {'; '.join(told)}."] if told else []
