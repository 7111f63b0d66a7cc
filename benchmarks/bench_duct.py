"""Cost of the reduced duct: basis, cache, step, contact rows, nonlinear force.

OPENBLAS_NUM_THREADS=1 python benchmarks/bench_duct.py            # all but the largest basis, a minute or two
OPENBLAS_NUM_THREADS=1 python benchmarks/bench_duct.py --large    # with 250,000 dofs
"""

from __future__ import annotations

import os

# Before numpy is loaded: a second BLAS thread only disturbs what is timed here.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

import numpy as np
from report import Row, measure, write_report

from trocar.services.mechanics.fem import ElementChoice, ShellModel, ShellSection, clamp
from trocar.services.mechanics.reduction import (
    DuctRecipe,
    ExactOscillator,
    ModalBasis,
    ModalState,
    Newmark,
    Residual,
    ResidualChoice,
    reduce_duct,
)
from trocar.services.mechanics.reduction.basis import gather_modes
from trocar.services.mechanics.reduction.build import build_basis
from trocar.services.mechanics.reduction.large_rotations.warping import SectionFrame, TubeWarp
from trocar.services.mechanics.reduction.modal_compliance import add_modal_compliance
from trocar.services.mechanics.reduction.nonlinear.quadratic_manifold import relaxed_membrane_force
from trocar.services.mechanics.reduction.recipe import MIB
from trocar.services.mechanics.reduction.residual.patches import largest_radius_m, patch_pattern
from trocar.services.mechanics.reduction.viscoelastic import PronySeries, ViscousModes
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct

SECTION = ShellSection(0.5e-3, 100e3, 0.45, 1060.0)
ELEMENTS = ElementChoice("andes", "dkt")
N_MODES = 100
DT_S = 1e-3
MESHES = {"8,000 dofs": (32, 42), "60,000 dofs": (80, 125), "250,000 dofs": (164, 254)}
BUDGETS = {"8,000 dofs": (2.0, None), "60,000 dofs": (15.0, 2.0), "250,000 dofs": (120.0, 12.0)}


def duct_mesh(n_around: int, n_along: int):
    return parametric_duct(DuctGeometry(4e-3, 40e-3, n_around, n_along))


def basis_rows(name: str) -> list[Row]:
    """Build one basis in a process of its own, so that its peak memory is its own."""
    command = [sys.executable, __file__, "--build", name]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    result = json.loads(done.stdout.splitlines()[-1])
    seconds, gib = BUDGETS[name]
    stages = ", ".join(f"{stage} {result[stage]:.2f} s" for stage in ("assembly", "factorisation", "modes"))
    note = f"{result['dofs']} free dofs; {stages}; processor time {result['cpu']:.2f} s"
    rows = [Row(f"basis, {name}, {N_MODES} modes", result["total"], "s", seconds, note=note)]
    return [*rows, Row(f"peak memory, {name}", result["peak_gib"], "GiB", gib)]


def build_alone(name: str) -> None:
    start, cpu_start = time.perf_counter(), time.process_time()
    mesh = duct_mesh(*MESHES[name])
    model = ShellModel(mesh, SECTION, [clamp(mesh)], ELEMENTS)
    dofs = model.K_free.shape[0]
    assembled = time.perf_counter()
    marks = {}
    build_basis(model, N_MODES, lambda stage, fraction: marks.setdefault((stage, fraction), time.perf_counter()))
    end = time.perf_counter()
    result = {
        "dofs": dofs,
        "assembly": assembled - start,
        "factorisation": marks["modes", 0.0] - assembled,
        "modes": end - marks["modes", 0.0],
        "total": end - start,
        "cpu": time.process_time() - cpu_start,
        "peak_gib": peak_memory_gib(),
    }
    print(json.dumps(result))


def peak_memory_gib() -> float:
    """High-water mark of this process alone; getrusage would count the parent that forked it."""
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    line = next(line for line in status.splitlines() if line.startswith("VmHWM"))
    return int(line.split()[1]) / 2**20


def cache_rows() -> list[Row]:
    rows = []
    for nodes, shape, choice in (
        ("1,376 nodes, full residual", MESHES["8,000 dofs"], ResidualChoice()),
        ("10,080 nodes, no residual", MESHES["60,000 dofs"], ResidualChoice("none")),
    ):
        mesh = duct_mesh(*shape)
        recipe = DuctRecipe(mesh, SECTION, (clamp(mesh),), N_MODES, ELEMENTS, choice)
        with tempfile.TemporaryDirectory() as folder:
            start = time.perf_counter()
            reduce_duct(recipe, 0.1, Path(folder))
            first_s = time.perf_counter() - start
            again = partial(reduce_duct, recipe, 0.1, Path(folder))
            timing = measure({"cache": again}, samples=9, warmup=1)["cache"]
        rows.append(Row.from_timing(f"start from cache, {nodes}", timing, 1.0, note=f"first start {first_s:.1f} s"))
    return rows


def random_basis(n_nodes: int, n_modes: int) -> ModalBasis:
    """Numbers of the right shape: what a step costs does not depend on their values."""
    rng = np.random.default_rng(0)
    omega = np.sort(rng.uniform(50.0, 2000.0, n_modes))
    return ModalBasis.from_modes(omega, rng.standard_normal((n_nodes, 3, n_modes)))


def step_rows() -> list[Row]:
    calls = {}
    for name, kind in (("Newmark", Newmark), ("exact oscillator", ExactOscillator)):
        integrator = kind(np.linspace(50.0, 2000.0, N_MODES), np.full(N_MODES, 0.1))
        state, force = ModalState.at_rest(N_MODES), np.ones(N_MODES)
        calls[name] = lambda i=integrator, s=state, f=force: i.predict(s, f, DT_S)
    timings = measure(calls, samples=2000, inner=10)
    return [Row.from_timing(f"step, {name}, r = {N_MODES}", timing, 5e-6) for name, timing in timings.items()]


class ContactTick:
    """One tick with contacts: step, gather rows and compliance, then apply forces and residual."""

    def __init__(self, basis: ModalBasis, residual: Residual, triangles: np.ndarray) -> None:
        k, r = len(triangles), basis.n_modes
        self.basis, self.residual, self.triangles = basis, residual, triangles
        self.weights = np.full((k, 3), 1.0 / 3.0)
        # Loads are merged on nodes, as the simulation does: neighbouring contacts share corners.
        self.loaded = np.unique(triangles).astype(np.int32)
        self.integrator = Newmark(basis.omega_rad_s, np.full(r, 0.1))
        self.gain = self.integrator.gains(DT_S).position
        self.state, self.force = ModalState.at_rest(r), np.zeros(r)
        self.modes, self.scratch = np.zeros((3 * k, r)), np.zeros(3 * k * r)
        self.moved = np.zeros((2, k, 3))
        self.W = np.zeros((3 * k, 3 * k))
        self.each = np.arange(k, dtype=np.int32)  # no point stands there twice
        self.contact_forces = np.ones(3 * k)
        self.loads, self.out = np.ones((self.loaded.size, 3)), np.zeros((self.loaded.size, 3))

    def step(self) -> None:
        self.integrator.predict(self.state, self.force, DT_S)

    def contacts(self) -> None:
        rows = (self.modes, *self.moved)
        gather_modes((self.triangles, self.weights), self.basis.Phi, (self.state.q, self.state.qdot), rows)
        self.residual.gather_points(self.triangles, self.weights, self.W, self.each)
        add_modal_compliance(self.modes, self.gain, self.scratch, self.W, self.each, 0)
        np.dot(self.contact_forces, self.modes, out=self.force)
        self.out[:] = 0.0
        self.residual.apply(self.loaded, self.loads, self.loaded, self.out)


def contact_rows() -> list[Row]:
    mesh = duct_mesh(*MESHES["8,000 dofs"])
    basis = random_basis(mesh.n_vertices, N_MODES)
    blocks = np.zeros((mesh.n_vertices, mesh.n_vertices, 3, 3), np.float32)
    nearest = np.argsort(np.linalg.norm(mesh.vertices_m[mesh.triangles[:, 0]] - [30e-3, 4e-3, 0.0], axis=1))
    ticks = {
        "33 contact rows gathered and applied (11 points, 3 directions)": nearest[:11],
        "96 contact rows (32 points)": nearest[:32],
    }
    calls = {}
    for name, chosen in ticks.items():
        tick = ContactTick(basis, Residual.full(blocks), mesh.triangles[chosen])
        calls[name] = tick.contacts
    timings = measure(calls, samples=1000)
    limits = (40e-6, None)
    return [Row.from_timing(name, t, limit) for (name, t), limit in zip(timings.items(), limits, strict=True)]


def mesh_size_rows() -> list[Row]:
    """The same tick on 1,000 and 20,000 nodes; contacts wander so that no cache holds their rows."""
    calls, contact_calls = {}, {}
    for n_around, n_along in ((25, 39), (100, 199)):
        mesh = duct_mesh(n_around, n_along)
        n = mesh.n_vertices
        starts, neighbours = patch_pattern(mesh.vertices_m, largest_radius_m(mesh.vertices_m, 64 * MIB))
        residual = Residual.patches(starts, neighbours, np.zeros((neighbours.size, 3, 3), np.float32))
        basis = random_basis(n, N_MODES)
        near = np.argsort(np.linalg.norm(mesh.vertices_m[mesh.triangles[:, 0]] - [30e-3, 4e-3, 0.0], axis=1))[:11]
        tick = ContactTick(basis, residual, mesh.triangles[near])
        calls[n], contact_calls[n] = tick.step, tick.contacts
    step = measure(calls, samples=2000, inner=10)
    contact = measure(contact_calls, samples=1000)
    small, large = step
    free = step[large].median_s / step[small].median_s
    with_contacts = (step[large].median_s + contact[large].median_s) / (step[small].median_s + contact[small].median_s)
    return [
        Row("step at 20,000 nodes over step at 1,000", free, "times", 1.3),
        Row("with 33 contact rows in patches of 64 MiB", with_contacts, "times", 1.3),
        Row.from_timing("33 contact rows in patches, 20,000 nodes", contact[large], 40e-6),
    ]


def effect_rows() -> list[Row]:
    mesh = duct_mesh(20, 30)
    model = ShellModel(mesh, SECTION, [clamp(mesh)], ElementChoice("cst", "dkt"))
    basis = build_basis(model, N_MODES)
    calls, rows, q = {}, [], np.full(N_MODES, 1e-6)
    for s in (10, 20, 30):
        start = time.perf_counter()
        force = relaxed_membrane_force(model, basis, s)
        rows.append(Row(f"nonlinear membrane built, s = {s}, 620 nodes", time.perf_counter() - start, "s"))
        out, scratch = np.zeros(N_MODES), np.zeros((2, s))
        calls[f"nonlinear membrane force, s = {s}"] = lambda f=force, o=out, w=scratch: f.add_force(q, o, w)
    viscous = ViscousModes(basis.omega_rad_s, PronySeries((0.2, 0.15, 0.1), (0.1, 1.0, 10.0)))
    out = np.zeros(N_MODES)

    def relax() -> None:
        viscous.add_force(out)
        viscous.relax(q, DT_S)

    calls["viscoelasticity, three terms, r = 100"] = relax
    frame = SectionFrame(TubeWarp.from_basis(mesh, basis, mesh.vertex_sets["clamped"]))
    nodes = mesh.vertex_sets["mouth"]
    warped_rows, no_residual = np.zeros((nodes.size, 3, N_MODES)), np.zeros((nodes.size, 3))
    calls["large rotations, axis of 24 sections, r = 100"] = lambda: frame.update(q)

    def turn_and_gather() -> None:
        frame.update(q)
        frame.node_rows(nodes, no_residual, warped_rows)

    calls["large rotations, axis, its derivative, rows of 20 nodes"] = turn_and_gather
    limits = {"nonlinear membrane force, s = 20": 15e-6}
    timings = measure(calls, samples=1000)
    return [*rows, *(Row.from_timing(name, timing, limits.get(name)) for name, timing in timings.items())]


NOTES = """Single thread. A step is `predict` of all modes under a force, called from Python; a contact row is one
direction at one point of a triangle. Contacts: the modes' rows, the residual between all points, their sum into the
contact compliance, and the modal force and residual displacement of all corner loads. Bases are built in a process
of their own; the time includes meshing and assembly, memory is the process's peak."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--large", action="store_true", help="also build the basis of 250,000 dofs")
    parser.add_argument("--build", choices=list(MESHES), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.build:
        build_alone(arguments.build)
        return
    rows = [*step_rows(), *contact_rows(), *mesh_size_rows(), *effect_rows(), *cache_rows()]
    for name in MESHES:
        if name != "250,000 dofs" or arguments.large:
            rows += basis_rows(name)
    write_report("duct", "Reduced duct", rows, NOTES)


if __name__ == "__main__":
    main()
