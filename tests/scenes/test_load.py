"""Scene files: every one of the repository loads, and every mistake is one sentence that names the key."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from trocar.services.mechanics.effects import EFFECTS
from trocar.services.mechanics.effects.mucus_drag import MucusDragSettings
from trocar.services.mechanics.scenarios import insertion_scene, miss
from trocar.services.mechanics.scene import SceneModel
from trocar.services.runtime.config import config
from trocar.services.scenes import load_scene, scene_file_type, scene_origins
from trocar.studies.paper_scene import paper_scene

SMALL = Path(__file__).parent / "small.yaml"
SCENES = sorted((config.config_directory() / "scenes").glob("*.yaml"))


@pytest.mark.parametrize("path", SCENES, ids=lambda p: p.stem)
def test_every_scene_file_of_the_repository_loads_and_has_the_effects_that_it_names(path: Path) -> None:
    said: dict[str, Any] = yaml.safe_load(path.read_text())
    assert set(said.get("effects", ())) <= set(load_scene(path).effects)  # its tissue may bring one more


@pytest.mark.parametrize("text", ["3e-4", "3.0e-4", "0.0003"])
def test_numbers_are_read_as_people_write_them(tmp_path: Path, text: str) -> None:
    path = tmp_path / "a.yaml"
    path.write_text(f"effects: {{mucus_drag: {{film_m: {text}}}}}")
    assert load_scene(path).effects == {"mucus_drag": MucusDragSettings(film_m=3e-4)}
    assert load_scene(SMALL, [f"effects.mucus_drag.film_m={text}"]).effects["mucus_drag"] == MucusDragSettings()


def test_the_schema_of_scene_files_knows_the_settings_of_every_effect() -> None:
    schema = scene_file_type().model_json_schema()
    effects = schema["$defs"]["Effects"]
    assert list(effects["properties"]) == list(EFFECTS)
    assert effects["additionalProperties"] is False
    assert "film_m" in schema["$defs"]["MucusDragSettings"]["properties"]


def test_overrides_win_and_are_remembered() -> None:
    scene, origins = scene_origins(SMALL, ["duct.n_modes=12", "effects.friction.mu_static=0.4"])
    assert scene.duct.n_modes == 12
    assert origins["duct.n_modes"] == "--set"
    assert origins["duct.n_along"] == str(SMALL)


def test_options_are_told_apart_by_their_first_key() -> None:
    rig, scene = config.split_overrides(["gateway.force_limit_n=1", "duct.n_modes=12", "scene=paper"])
    assert rig == ("gateway.force_limit_n=1", "scene=paper")
    assert scene == ("duct.n_modes=12",)


@pytest.mark.parametrize(
    ("name", "model"),
    [("insertion", insertion_scene()), ("miss", miss().scene), ("paper", paper_scene())],
    ids=["insertion", "miss", "paper"],
)
def test_scene_files_are_the_scenes_that_the_mechanics_tests(name: str, model: SceneModel) -> None:
    """What is tested in process is what the rig runs."""
    assert load_scene(name) == model
