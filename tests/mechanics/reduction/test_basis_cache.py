"""The cache of reduced ducts: found by content, made once, whole or absent, and checked when read."""

import dataclasses
import os
import shutil
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from trocar.services.mechanics.effects.insufflation import InsufflationSettings
from trocar.services.mechanics.fem import ElementChoice, ShellSection, clamp
from trocar.services.mechanics.reduction import DuctRecipe, ResidualChoice, cache, reduce_duct
from trocar.services.mechanics.reduction.content_hash import hash_content
from trocar.services.mechanics.scene import DuctScene, SceneModel
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct, scene_mesh
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct


def small_recipe(**changes) -> DuctRecipe:
    mesh = parametric_duct(DuctGeometry(4e-3, 20e-3, 10, 8))
    section = ShellSection(0.5e-3, 100e3, 0.45, 1060.0)
    recipe = DuctRecipe(mesh, section, (clamp(mesh),), 12, ElementChoice("andes", "dkt"))
    return dataclasses.replace(recipe, **changes)


def test_second_start_computes_nothing_and_returns_the_same_bits(tmp_path):
    stages = []
    first = reduce_duct(small_recipe(), 0.05, tmp_path, lambda stage, fraction: stages.append((stage, fraction)))
    names = [stage for stage, _ in stages]
    assert {"assembly", "factorisation", "modes", "residual compliance"} == set(names)
    assert stages[-1] == ("residual compliance", 1.0)
    again = reduce_duct(small_recipe(), 0.05, tmp_path, lambda stage, _: pytest.fail(f"computed {stage} again"))
    assert again.basis.content_hash == first.basis.content_hash
    assert np.array_equal(again.basis.Phi, first.basis.Phi)
    assert np.array_equal(again.residual.blocks, first.residual.blocks)


def test_a_warm_start_of_a_loaded_scene_solves_nothing(tmp_path):
    """Gas pressure moves the rest shape by a static solution of the full model: kept too, and by what it hangs on."""
    duct = DuctScene(length_m=20e-3, n_around=10, n_along=8, n_modes=12)
    scene, stages = SceneModel(duct=duct, effects={"insufflation": InsufflationSettings()}), []
    first = build_scene_duct(scene, tmp_path, lambda stage, fraction: stages.append((stage, fraction)))
    assert stages[-1] == ("rest shape", 1.0)
    assert np.abs(first.mesh.vertices_m - scene_mesh(duct).vertices_m).max() > 1e-9
    again = build_scene_duct(scene, tmp_path, lambda stage, _: pytest.fail(f"computed {stage} again"))
    assert np.array_equal(again.mesh.vertices_m, first.mesh.vertices_m)
    pressures = [path.name for path in tmp_path.glob("rest-*")]
    other = dataclasses.replace(scene, effects={"insufflation": InsufflationSettings(outside_pa=1000.0)})
    assert not np.array_equal(build_scene_duct(other, tmp_path).mesh.vertices_m, first.mesh.vertices_m)
    assert len(pressures) == 1
    assert len(list(tmp_path.glob("rest-*"))) == 2


def test_long_stages_tell_how_far_they_are(tmp_path):
    told = []
    reduce_duct(small_recipe(), 0.05, tmp_path, lambda stage, fraction: told.append((stage, fraction)))
    for stage in ("modes", "residual compliance"):
        fractions = [fraction for name, fraction in told if name == stage]
        assert len(fractions) >= 3, told
        assert fractions == sorted(fractions)
        assert (fractions[0] < 1.0, fractions[-1]) == (True, 1.0)


@pytest.mark.parametrize("kind", ["full", "cyclic", "patches"])
def test_processes_have_the_blocks_in_memory_once_and_nobody_writes_to_them(tmp_path, kind):
    """What may be written to, on no matter what condition, is each process's own as soon as its memory is locked."""
    recipe = small_recipe(residual=ResidualChoice(kind, patch_radius_m=4e-3))
    for residual in (reduce_duct(recipe, 0.05, tmp_path).residual for _ in ("made", "found")):
        with pytest.raises(ValueError, match="read-only"):
            residual.blocks[0, 0, 0] = 1.0
        mapped = [line.split() for line in Path("/proc/self/maps").read_text().splitlines()]
        access = {fields[1] for fields in mapped if fields[-1].startswith(str(tmp_path)) and "residual-" in fields[-1]}
        assert access == {"r--s"}


def test_modes_are_memory_of_the_process(tmp_path):
    """Kernels are handed the modes in every tick, and an array that cannot be written to is another kind of array."""
    for basis in (reduce_duct(small_recipe(), 0.05, tmp_path).basis for _ in ("made", "found")):
        assert basis.Phi.flags.writeable
        assert "/phi.npy" not in Path("/proc/self/maps").read_text()


@pytest.mark.parametrize(
    "changes",
    [
        {"n_modes": 13},
        {"elements": ElementChoice("cst", "dkt")},
        {"section": ShellSection(0.5e-3, 101e3, 0.45, 1060.0)},
        {"mesh": parametric_duct(DuctGeometry(4e-3, 20.001e-3, 10, 8))},
    ],
)
def test_any_change_of_the_recipe_changes_the_key(changes):
    assert small_recipe(**changes).key() != small_recipe().key()


def test_equal_recipes_share_a_key_and_residual_choices_share_a_basis(tmp_path):
    assert small_recipe().key() == small_recipe().key()
    for kind in ("full", "patches", "none"):
        choice = ResidualChoice(kind, patch_radius_m=4e-3)
        duct = reduce_duct(small_recipe(residual=choice), 0.05, tmp_path)
        assert duct.residual.n_nodes == duct.basis.n_nodes
    assert len(list(tmp_path.glob("basis-*"))) == 1
    assert len(list(tmp_path.glob("residual-*"))) == 2


def test_auto_takes_a_sector_beyond_the_budget_where_the_mesh_has_copies_of_it(tmp_path):
    duct = reduce_duct(small_recipe(residual=ResidualChoice(budget_bytes=100_000)), 0.05, tmp_path)
    assert duct.residual.blocks.nbytes == 36 * 90**2 / 5
    again = reduce_duct(small_recipe(residual=ResidualChoice(budget_bytes=100_000)), 0.05, tmp_path)
    assert np.array_equal(again.residual.blocks, duct.residual.blocks)
    assert again.residual.store.odd.tobytes() == duct.residual.store.odd.tobytes()


def test_auto_takes_patches_beyond_the_budget(tmp_path):
    cut = parametric_duct(DuctGeometry(4e-3, 20e-3, 10, 8, cut_angle_rad=0.1))
    small = small_recipe(mesh=cut, residual=ResidualChoice(budget_bytes=100_000))
    duct = reduce_duct(small, 0.05, tmp_path)
    assert duct.residual.store.starts.size
    assert duct.residual.blocks.nbytes < 100_000
    again = reduce_duct(small, 0.05, tmp_path)
    assert again.residual_error == duct.residual_error
    assert duct.residual_error.kept < 1e-5 < duct.residual_error.dropped
    assert reduce_duct(small_recipe(), 0.05, tmp_path).residual_error is None


@pytest.mark.parametrize("name", ["basis-*/phi.npy", "basis-*/manifest.json", "residual-*/blocks.npy"])
@pytest.mark.parametrize("cut", [False, True])
def test_a_flipped_bit_and_a_cut_are_made_anew_and_said(tmp_path, name, cut, capfd):
    sound = reduce_duct(small_recipe(), 0.05, tmp_path)
    file = next(tmp_path.glob(name))
    content = bytearray(file.read_bytes())
    content[-9] ^= 1
    file.unlink()  # as a new file, so that what `sound` has mapped stays
    file.write_bytes(content[: len(content) // 2] if cut else content)
    again = reduce_duct(small_recipe(), 0.05, tmp_path)
    assert np.array_equal(again.basis.Phi, sound.basis.Phi)
    assert np.array_equal(again.residual.blocks, sound.residual.blocks)
    assert capfd.readouterr().err == f"{file.parent} is not as it was written; it is made anew\n"


def _is_whole_with(cache_dir, number):
    return cache.fetch(cache_dir, "entry", lambda entry: entry.save("data", np.array([number]))).load("data")[0]


@pytest.mark.parametrize("what", ["mode", "owner", "file", "link"])
def test_an_entry_that_others_can_change_or_that_is_no_folder_is_made_anew_and_said(tmp_path, what, capfd):
    assert _is_whole_with(tmp_path, 1) == _is_whole_with(tmp_path, 2) == 1
    entry = tmp_path / "entry"
    if what == "mode":
        entry.chmod(0o777)
        why = f"others may write to {entry} (mode 0777)"
    elif what == "owner":
        if os.geteuid() != 0:
            pytest.skip("only root gives files away")
        os.chown(entry, 65534, 65534)
        why = f"{entry} belongs to user 65534"
    else:
        shutil.rmtree(entry)
        entry.touch() if what == "file" else entry.symlink_to("nowhere")
        why = "it is no folder"
    assert _is_whole_with(tmp_path, 3) == 3
    assert capfd.readouterr().err == f"{entry} is not used: {why}; it is made anew\n"
    assert entry.stat().st_mode & 0o777 == 0o700
    assert sorted(path.name for path in tmp_path.iterdir()) == [".entry.lock", "entry"]


def test_a_build_that_fails_leaves_nothing_behind(tmp_path):
    def fail(entry):
        entry.save("half", np.ones(3))
        raise RuntimeError("power cut")

    with pytest.raises(RuntimeError, match="power cut"):
        cache.fetch(tmp_path, "entry", fail)
    assert [path.name for path in tmp_path.iterdir()] == [".entry.lock"]


def test_those_who_ask_together_make_an_entry_once(tmp_path):
    # The lock belongs to the open file, so threads exclude each other as processes do.
    made, together = [], threading.Barrier(4)

    def make(entry):
        made.append(entry)
        entry.save("data", np.arange(10))

    def ask(_):
        together.wait(120)
        return cache.fetch(tmp_path, "entry", make).load("data")

    with ThreadPoolExecutor(4) as pool:
        results = list(pool.map(ask, range(4)))
    assert len(made) == 1
    assert all(np.array_equal(result, np.arange(10)) for result in results)


def test_content_hash_tells_types_and_shapes_apart():
    values = [1, 1.0, "1", True, None, np.ones(1), np.ones((1, 1)), np.ones(1, np.float32), (1,), [1, 1], {"a": 1}]
    assert len({hash_content(value) for value in values}) == len(values)
    with pytest.raises(TypeError, match="cannot name the content of a set"):
        hash_content({1})
