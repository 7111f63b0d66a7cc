"""What is learned of a wall is named by all the code that it follows from: changed code does not meet old results."""

from pathlib import Path

import pytest

from trocar.services.kernels.source_closure import Sources
from trocar.services.mechanics.reduction.content_hash import hash_sources
from trocar.services.mechanics.reduction.hyperelastic import energy_sampling
from trocar.services.mechanics.reduction.softening import training

ROOT = Path(__file__).parents[3]
IN_THE_RECIPE = ("trocar.services.mechanics.fem",)
NOT_NUMBERS = (
    "trocar.services.files.cache_directory",
    "trocar.services.files.trusted_path",
    "trocar.services.mechanics.arrays",
    "trocar.services.mechanics.compiled",
    *(
        f"trocar.services.mechanics.reduction.{name}"
        for name in (
            "cache",
            "content_hash",
            "recipe",
            "build",
            "basis",
            "coincident_points",
            "reduced_duct",
            "modal_state",
        )
    ),
    # The reduced duct, which brings these along, has a hash of its own.
    "trocar.services.mechanics.reduction.large_rotations",
    "trocar.services.mechanics.reduction.residual",
    "trocar.services.mechanics.surface.cyclic_symmetry",
)


@pytest.mark.parametrize("module", [training, energy_sampling])
def test_every_module_with_numbers_is_in_the_name(module):
    elsewhere = (*IN_THE_RECIPE, *NOT_NUMBERS)
    missing = [
        name
        for name in Sources(ROOT).closure(module.__name__)
        if not any(name == other or name.startswith(f"{other}.") for other in elsewhere)
        and not any(_path(name).is_relative_to(place) for place in module.SOURCES)
    ]
    assert not missing


def test_a_changed_file_changes_the_name(tmp_path):
    folder, file = tmp_path / "folder", tmp_path / "file.py"
    folder.mkdir()
    (folder / "one.py").write_text("x = 1")
    file.write_text("y = 1")
    before = hash_sources(folder, file)
    file.write_text("y = 2")
    assert hash_sources(folder, file) != before
    with pytest.raises(FileNotFoundError):
        hash_sources(folder, tmp_path / "missing.py")


def _path(name: str) -> Path:
    stem = ROOT.joinpath(*name.split("."))
    return stem.with_suffix(".py") if stem.with_suffix(".py").is_file() else stem / "__init__.py"
