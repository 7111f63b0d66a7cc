"""An effect that a scene does not name is not there: the same run in a build in which its file is deleted.

By day several are deleted at once, which takes a process for each group; one by one in the long run.
The build without it is a process in which the file cannot be imported and the table lacks its import and its row:
a copy of the tree would have to compile every kernel again.
"""

from __future__ import annotations

import subprocess
import sys

import pytest

from trocar.services.mechanics.effects import EFFECTS

N_GROUPS = 2
#: Deletes files, and what of the table names their classes, from what this process imports.
HIDE = """
import ast, importlib.abc, importlib.machinery
TABLE, GONE, KINDS = "trocar.services.mechanics.effects", {modules!r}, {kinds!r}

class Without(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name in GONE:
            raise ModuleNotFoundError(f"{{name}} is deleted")
        spec = importlib.machinery.PathFinder.find_spec(name, path)
        if name == TABLE:
            spec.loader = Shorter(name, spec.origin)
        return spec if name == TABLE else None

class Shorter(importlib.machinery.SourceFileLoader):
    def get_code(self, fullname):
        tree = ast.parse(self.get_source(fullname))
        (table,) = [each.value for each in tree.body if isinstance(each, ast.AnnAssign) and each.target.id == "EFFECTS"]
        for kind in KINDS:
            imports = [each for each in tree.body if isinstance(each, ast.ImportFrom) and names(each.names) == [kind]]
            rows = [k for k, row in enumerate(table.values) if row.args[0].id == kind]
            assert len(imports) == len(rows) == 1, "an effect is one import and one row"
            tree.body.remove(imports[0])
            del table.keys[rows[0]], table.values[rows[0]]
        return compile(tree, self.path, "exec")

def names(imported):
    return [each.name for each in imported]

sys.meta_path.insert(0, Without())
"""
#: Puts modules in the place of others that know every name, and all that any of them does is to return None.
STAND_INS = """
import sys, types
for name in {modules!r}:
    sys.modules[name] = types.ModuleType(name)
    sys.modules[name].__getattr__ = lambda asked: lambda *_: None
"""
FEATURES = [
    *(f"trocar.services.mechanics.bodies.{name}" for name in ("catheter_drive", "wire_drive", "guide_wire")),
    *(
        "trocar.services.mechanics.rod.guide_wire",
        "trocar.services.mechanics.scene.duct_tubes",
        "trocar.services.meshes.branching",
    ),
]
#: A line for each argument, which names the effects that are left out, with commas between them.
#: Both tools press a duct with a catheter in it, one from above and one aside, with every other effect but the two that
#: take seconds to prepare: the state to the last bit, how many calls of stages a step makes and how many instructions
#: of the interpreter it takes, and whether anything was touched.
RUN = """
import hashlib, sys
{hide}
import numpy as np
from trocar.services.mechanics.effects import EFFECTS
from trocar.services.mechanics.scene import CatheterScene, DuctScene, ForcepsScene, SceneModel
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct
from tests.instructions import instructions
for left_out in (names.split(",") for names in sys.argv[1:]):
    others = [name for name in EFFECTS if name not in (*left_out, "softening", "hyperelasticity")]
    scene = SceneModel(
        duct=DuctScene(n_around=12, n_along=14, n_modes=20, thickness_m=1e-3, youngs_modulus_pa=300e3),
        catheter=CatheterScene(n_segments=30, tip_position_m=(25e-3, 0.0, 0.0), introducer_to_tip_m=65e-3),
        forceps=(ForcepsScene(port_position_m=(20e-3, 0.0, 0.15)), ForcepsScene(port_position_m=(60e-3, 10e-3, 0.15))),
        effects={{name: EFFECTS[name].kind.Settings() for name in others}},
    )
    simulation, tools = Simulation(scene, build_scene_duct(scene)), ToolInputs()
    state, touched = hashlib.blake2b(), 0
    for tick in range(400):
        down = 5e-3 * np.sin(np.pi * tick / 400.0) ** 2
        tools.position_m[0] = 20e-3, 1e-3 * np.sin(tick / 40.0), 23e-3 - 1.6 * down
        tools.position_m[1] = 55e-3, 0.0, 22e-3 - 3.2 * down
        simulation.step(tools)
        touched = max(touched, simulation.contacts.n_contacts)
        state.update(simulation.catheter.state.position_m.tobytes() + simulation.duct.state.q.tobytes())
        state.update(simulation.tool_results.force_n.tobytes())
    calls = sum(map(len, simulation._stages.values()))
    known = len(EFFECTS.keys() & set(left_out))
    print(known, touched > 5, state.hexdigest(), calls, instructions(simulation.step, tools))
"""


#: Each group leaves the others what they rest on to touch something: contacts, friction, a wall that gives way.
GROUPS = [list(EFFECTS)[k::N_GROUPS] for k in range(N_GROUPS)]

pytestmark = pytest.mark.timeout(600)  # the first of the processes may have every kernel to compile


def outcomes(left_out: list[list[str]], hide: str) -> list[list[str]]:
    """Return what comes of each run of one process, without the effects that are left out of it."""
    command = [sys.executable, "-c", RUN.format(hide=hide), *map(",".join, left_out)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return [line.split() for line in done.stdout.splitlines()]


@pytest.fixture(scope="module")
def off(request):
    """What comes of the build as it is, by the effects that are left out: one process runs all."""
    left_out = [[], *GROUPS, *([name] for name in EFFECTS if request.config.getoption("--long"))]
    return dict(zip(map(tuple, left_out), outcomes(left_out, ""), strict=True))


def assert_off_is_as_deleted(names: list[str], off: list[str]) -> None:
    kinds = [EFFECTS[name].kind for name in names]
    gone = {"modules": [kind.__module__ for kind in kinds], "kinds": [kind.__name__ for kind in kinds]}
    (deleted,) = outcomes([names], HIDE.format(**gone))
    assert off[:2] == [str(len(names)), "True"]
    assert deleted[0] == "0"
    assert off[1:] == deleted[1:]  # the state to the last bit, as many calls of stages and instructions: off costs none
    assert int(off[4]) > 1000


@pytest.mark.parametrize("names", GROUPS, ids="-".join)
def test_off_is_bit_identical_to_a_build_without_them(names, off):
    assert_off_is_as_deleted(names, off[tuple(names)])


def test_a_scene_without_branches_drives_and_wires_is_bit_identical_to_a_build_without_them(off):
    """And a step of it takes as many instructions: what is not there is asked for, and nothing of it runs."""
    (without,) = outcomes([[]], STAND_INS.format(modules=FEATURES))
    assert off[()][1] == "True"
    assert off[()] == without


@pytest.mark.long
@pytest.mark.parametrize("name", list(EFFECTS))
def test_off_is_bit_identical_to_a_build_without_it(name, off):
    assert_off_is_as_deleted([name], off[name,])
