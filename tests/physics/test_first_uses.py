"""No scene's ordinary play uses anything for the first time once it runs: a second play in the process finds no more.

`test_late_kernels` asks that of a rig, in which haptics decides on grasps. Here the simulation decides on its own, as
in a study or a program, and whatever numba has compiled or loaded counts, not the kernels of a tick alone.
"""

from __future__ import annotations

import gc
import json
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.by_day import by_day
from tests.kernels.preloaded import Preloaded
from tests.physics.test_late_kernels import SMALL
from tests.scenes.test_hands import write_stl
from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.compiled import KERNELS
from trocar.services.mechanics.scene import DuctScene
from trocar.services.mechanics.simulation.scene_duct import scene_mesh
from trocar.services.runtime.config.config import config_directory
from trocar.services.scenes import load_scene
from trocar.studies.first_uses import Plays

ROOT = Path(__file__).parents[2]
BY_DAY = ["everything", "anatomy"]
SCENES = sorted(path.stem for path in (config_directory() / "scenes").glob("*.yaml"))
WITH_HANDS = [name for name in SCENES if name == "anatomy" or not load_scene(name, []).duct_alone]

PLAY = "import sys; from tests.physics import test_first_uses as test; test.play(sys.argv[1], sys.argv[2:])"


@pytest.fixture(scope="module")
def preloaded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Preloaded]:
    with Preloaded(tmp_path_factory.mktemp("twice"), "import tests.physics.test_first_uses") as made:
        yield made


@pytest.mark.timeout(900)  # on a machine that has compiled nothing yet
@pytest.mark.parametrize("scene", by_day(BY_DAY, [name for name in WITH_HANDS if name not in BY_DAY]))
def test_a_scene_that_is_played_uses_nothing_for_the_first_time(
    scene: str, preloaded: Preloaded, tmp_path: Path
) -> None:
    overrides = SMALL if scene == "everything" else []  # its wall learns for minutes, and `test_late_kernels` has one
    if scene == "anatomy":
        overrides = [f"duct.mesh_file={_surface(tmp_path)}", "duct.n_modes=30"]
    run = preloaded.start(PLAY, [scene, *overrides], ROOT, os.environ).wait()
    assert run.returncode == 0, run.stderr
    assert json.loads(run.stdout.splitlines()[-1]) == [[], []]


def _surface(folder: Path) -> Path:
    pytest.importorskip("trimesh", reason="needs the mesh packages")
    bent = DuctScene(radius_m=6e-3, length_m=42e-3, n_around=24, n_along=34, taper=0.2, curvature_1_m=6.0)
    write_stl(scene_mesh(bent), folder / "bent.stl")
    return folder / "bent.stl"


def _signatures() -> set[str]:
    """Return everything that numba has compiled or loaded in this process, with the types that it takes."""
    kind = type(KERNELS[0])
    compiled = [each for each in gc.get_objects() if isinstance(each, kind)]
    return {f"{each.py_func.__qualname__} {types}" for each in compiled for types in each.signatures}


def play(name: str, overrides: list[str]) -> None:
    """Print what each of two plays of a scene compiles or loads."""
    plays, new = Plays(load_scene(name, overrides), cache_directory()), []
    for _ in range(2):
        before = _signatures()
        assert np.isfinite(plays.play()).all()
        new.append(sorted(_signatures() - before))
    print(json.dumps(new))
