"""Scene files: every one of the repository loads, and every mistake is one sentence that names the key."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from trocar.services.mechanics.effects import EFFECTS
from trocar.services.mechanics.effects.mucus_drag import MucusDragSettings
from trocar.services.mechanics.scenarios import insertion_scene, miss
from trocar.services.mechanics.scene import SceneModel
from trocar.services.runtime.config import config
from trocar.services.runtime.errors import ConfigError
from trocar.services.scenes import check_duct, load_duct, load_scene, scene_file_type, scene_origins
from trocar.studies.paper_scene import paper_scene

SMALL = Path(__file__).parent / "small.yaml"
SCENES = sorted((config.config_directory() / "scenes").glob("*.yaml"))


@pytest.mark.parametrize("path", SCENES, ids=lambda p: p.stem)
def test_every_scene_file_of_the_repository_loads_and_has_the_effects_that_it_names(path: Path) -> None:
    said: dict[str, Any] = yaml.safe_load(path.read_text())
    assert set(said.get("effects", ())) <= set(load_scene(path).effects)  # its tissue may bring one more


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("duct: {radius: 4}", r"a.yaml: duct.radius: unknown key 'radius'; known: .*radius_m"),
        ("tube: {}", r"a.yaml: tube: unknown key 'tube'; known: .*duct"),
        ("duct: {tissue: liver}", r"a.yaml: duct.tissue: unknown tissue 'liver'; known: reference_duct, porcine"),
        ("duct: {tissue: 3}", r"a.yaml: duct.tissue: input should be a valid string"),
        ("{duct: {tissue: soft_cystic_duct}, effects: [gravity]}", r"a.yaml: effects: input should be an object"),
        ("duct: {radius_m: wide}", r"a.yaml: duct.radius_m: input should be a valid number"),
        ("forceps: [{jaw: 1}, {}]", r"forceps.0.jaw: unknown key 'jaw'; known: .*jaw_length_m"),
        ("effects: {magic: {}}", r"a.yaml: effects.magic: unknown key 'magic'; known: .*gravity"),
        ("effects: {friction: {mu: 0.3}}", r"effects.friction.mu: unknown key 'mu'; known: .*mu_static"),
        ("effects: {twist: {gj: 0.3}}", r"effects.twist.gj: unknown key 'gj'; known: none"),
        ("effects: {mucus_drag: {film_m: thin}}", r"effects.mucus_drag.film_m: input should be a valid number"),
        ("effects: {mucus_drag: {film_m: '3e-4'}}", r"effects.mucus_drag.film_m: input should be a valid number"),
        ("effects: {mucus_drag: {film_m: 0}}", r"effects.mucus_drag: film_m must be positive, is 0"),
        (
            "effects: {mucus_drag: {film_m: 1.0e-3}}",
            r"effects.mucus_drag.film_m: 0.001 m is more than contact.margin_m",
        ),
        (
            "effects: {gallstones: {bile_viscosity_pa_s: -1}}",
            r"effects.gallstones: bile_viscosity_pa_s must not be nega",
        ),
        ("effects: {anisotropy: {modulus_ratio: 0}}", r"effects.anisotropy: modulus_ratio must be positive, is 0"),
        (
            "effects: {anisotropy: {poisson_ratio: 0.45}}",
            r"effects.anisotropy: poisson_ratio 0.45 must be below .*0.417",
        ),
        ("effects: {anisotropy: {axis: [0, 0, 0]}}", r"effects.anisotropy: axis must not be zero"),
        ("catheter: {direction: [0, 0, 0]}", r"a.yaml: catheter.direction: must not be zero"),
        (
            "catheter: {inner_diameter_m: 0.01}",
            r"a.yaml: catheter.inner_diameter_m: must be below outer_diameter_m",
        ),
        (
            "catheter: {poisson_ratio: 0.6}",
            r"a.yaml: catheter.poisson_ratio: must lie above -1 and not above 0.5",
        ),
        ("catheter: {n_segments: 1000000}", r"a.yaml: catheter.n_segments: must not be above 1000, is 1000000"),
        ("catheter: {youngs_modulus_pa: 1.0e+300}", r"a.yaml: catheter.youngs_modulus_pa: must not be above 1e\+30 in"),
        (
            "catheter: {tip_position_m: [0, -1.0e+99, 0]}",
            r"a.yaml: catheter.tip_position_m.1: must not be above 1e",
        ),
        ("duct: {length_m: 40, radius_m: 4, thickness_m: 0.5}", r"a.yaml: duct.length_m: must not be above 2, is 40"),
        ("catheter: {length_m: 120}", r"catheter.length_m: must not be above 10 m, is 120; is it in another unit\?"),
        (
            "forceps: [{}, {port_position_m: [10, -70, 110]}]",
            r"forceps.1.port_position_m.1: must not be above 10 m, is -70; is it in another unit\?",
        ),
        ("contact: {capacity: 1000000}", r"a.yaml: contact.capacity: must not be above 1000, is 1000000"),
        ("duct: {radius_m: 1.0e-9}", r"a.yaml: duct: thickness_m leaves no lumen at the mouth"),
        ("duct: {n_around: 2}", r"a.yaml: duct: n_around must be at least 3"),
        ("duct: {poisson_ratio: 0.6}", r"a.yaml: duct: poisson_ratio of an isotropic material must not exceed 0.5"),
        ("contact: {recovery: 1.5}", r"contact.recovery: must not be above 1, is 1.5"),
        ("forceps: [{jaw_stiffness_nm_rad: 0}, {}]", r"forceps.0.jaw_stiffness_nm_rad: must be positive, is 0"),
        ("forceps: [{}, {grip_friction: -0.1}]", r"forceps.1.grip_friction: must not be negative, is -0.1"),
        ("effects: {gravity: {on_duct: 1}}", r"effects.gravity.on_duct: input should be a valid boolean"),
        (
            "effects: {gravity: {acceleration_m_s2: [0, 0]}}",
            r"gravity.acceleration_m_s2.2: this key is missing",
        ),
        ("effects: {friction: {mu_kinetic: 0.5}}", r"a.yaml: effects.friction: kinetic friction 0.5 is not within"),
        ("effects: {viscoelasticity: {g: [0.9, 0.2]}}", r"effects.viscoelasticity: .* 2 shares do not fit 3"),
        ("effects: [gravity]", r"a.yaml: effects: input should be an object"),
        ("duct: {n_modes: 12.5}", r"duct.n_modes: input should be a valid integer"),
        ("duct: {radius_m: '4e-3'}", r"duct.radius_m: input should be a valid number"),
        ("duct: {mesh_unit: furlong}", r"a.yaml: duct.mesh_unit: input should be 'm', 'cm', 'mm', 'um' or 'in'"),
        ("duct: {radius_m: .nan}", r"duct.radius_m: input should be a finite number"),
        ("catheter: {length_m: true}", r"catheter.length_m: input should be a valid number"),
        ("forceps: [{}, {}, {}]", r"a.yaml: forceps: at most 2, are 3"),
        ("forceps: [{}, {kind: spoon}]", r"a.yaml: forceps.1.kind: there is no tool 'spoon'; known: forceps, probe"),
        ("forceps: [{}, {kind: [probe]}]", r"a.yaml: forceps.1.kind: there is no tool \['probe'\]; known: forceps, p"),
        ("forceps: [{}, 3]", r"a.yaml: forceps.1: input should be an object"),
        ("forceps: 3", r"a.yaml: forceps: input should be a valid"),
        (
            "forceps: [{}, {kind: probe, jaw_length_m: 0.01}]",
            r"a.yaml: forceps.1.jaw_length_m: unknown key 'jaw_length_m'; known: coupling_.*, tip_radius_m$",
        ),
        ("forceps: [{}, {kind: probe, tip_radius_m: 0}]", r"forceps.1.tip_radius_m: must be positive, is 0"),
        ("forceps: [{tip_radius_m: 1.0e-3}]", r"a.yaml: forceps.0.tip_radius_m: unknown key 'tip_radius_m'; known"),
        ("forceps: [{kind: probe}]", r"a.yaml: hands: insertion needs jaws, and forceps.0 is a probe; press does wi"),
        ("{forceps: [{}, {kind: probe}], hands: pinch}", r"hands: pinch needs jaws, and forceps.1 is a probe"),
        ("{duct: {}, hands: pinch}", r"a.yaml: hands: pinch needs a tool, and the scene names but a duct"),
        (
            "{duct: {}, effects: {friction: {}}}",
            r"a.yaml: effects.friction: acts on nothing where there is but a duct; these act on its wall: anisotropy",
        ),
        ("duct_alone: true", r"a.yaml: duct_alone: unknown key"),
        ("catheter: {n_segments: 1}", r"a.yaml: catheter: n_segments is 1; a rod needs at least 2 segments"),
        ("catheter: {introducer_to_tip_m: 0.2}", r"a.yaml: catheter.introducer_to_tip_m: 0.2 m leaves the catheter"),
        ("catheter: {rest_curvature_1_m: [[0, 9, 0]]}", r"catheter.rest_curvature_1_m: .*name the effect 'twist' too"),
        (
            "{effects: {twist: {}}, catheter: {rest_curvature_1_m: [[0, 9, 0]]}}",
            r"a.yaml: catheter: rest_curvature_1_m must be finite, of shape \(49, 3\)",
        ),
        ("quality: [{iterations: '30'}]", r"quality.0.iterations: input should be a valid integer"),
        ("quality: [{}, {}]", r"a.yaml: quality.1.name: there is a rung 'full' above"),
        ("quality: [{}, {name: low, cost_us: 9.0}]", r"quality.1.cost_us: was measured either for every rung or for"),
        ("quality: [{cost_us: 9.0}, {name: a, cost_us: 9.5}]", r"quality.1.cost_us: must be less than .*, is 9.5"),
        ("quality: [{cost_us: 0.0}]", r"quality.0.cost_us: must be positive, is 0.0"),
        ("quality: [{force_error_percent: -1.0}]", r"quality.0.force_error_percent: must not be negative"),
        ("quality: []", r"a.yaml: quality: needs one to 16 rungs, has 0"),
        ("{effects: {gravity: {}}, quality: [{without: [gravity]}]}", r"quality.0.without: gravity cannot rest"),
        ("essential: [twist]", r"a.yaml: essential: the scene has no effect 'twist'"),
        ("sleeping: 1", r"sleeping: input should be a valid boolean"),
        ("contact: {model: hope}", r"contact.model: input should be 'implicit' or 'penalty'"),
    ],
)
def test_a_mistake_is_one_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "a.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=sentence) as caught:
        load_scene(path)
    assert "\n" not in str(caught.value)


_WIRED = {"anchor": "introducer", "inner_diameter_m": 1e-3, "outer_diameter_m": 2e-3, "guide_wire": {}}
_TOOLS = {"forceps": [{"kind": "drive"}, {"kind": "wire_drive"}], "hands": "drive", "effects": {"twist": {}}}


@pytest.mark.parametrize(
    ("scene", "catheter", "wire", "sentence"),
    [
        ({"forceps": [{"kind": "drive"}]}, {}, {}, r"guide_wire: goes with one tool of kind wire_drive"),
        ({}, {"guide_wire": None}, {}, r"guide_wire: goes with one tool of kind wire_drive, and that with it"),
        ({"effects": {}}, {}, {}, r"guide_wire: turns in the catheter, name the effect 'twist' too"),
        ({}, {"anchor": "free"}, {}, r"guide_wire: needs a catheter with anchor introducer and integrator"),
        ({}, {"integrator": "semi_implicit"}, {}, r"guide_wire: needs .* and integrator implicit"),
        *(
            ({"effects": {"twist": {}, name: {}}}, {}, {}, rf"guide_wire: the effect '{name}' knows a cath")
            for name in ("gravity", "mucus_drag", "self_contact")
        ),
        ({}, {"inner_diameter_m": 0.7e-3}, {}, r"guide_wire.outer_diameter_m: must be below the catheter's inner_diam"),
        ({}, {}, {"poisson_ratio": 0.6}, r"guide_wire.poisson_ratio: must lie above -1 and not above 0.5, is 0.6"),
        ({}, {}, {"out_m": 4e-3}, r"guide_wire.out_m: must lie within least_out_m and reach_m, .*, is 0.004"),
        ({}, {}, {"out_m": 41e-3}, r"guide_wire.out_m: must lie within least_out_m and reach_m, .*, is 0.041"),
        ({}, {}, {"reach_m": 0.2}, r"guide_wire.out_m: must lie .*, that below the catheter's length"),
        ({}, {}, {"friction": -0.1}, r"guide_wire.friction: must not be negative, is -0.1"),
        *(
            ({}, {}, {name: 0.0}, rf"guide_wire.{name}: must be positive, is 0")
            for name in ("outer_diameter_m", "youngs_modulus_pa", "density_kg_m3", "out_m", "least_out_m", "reach_m")
        ),
        ({}, {}, {"sections": [{"length_m": 0.0}]}, r"guide_wire.sections.0.length_m: must be positive, is 0"),
        *(
            (
                {},
                {},
                {"sections": [{"length_m": 5e-3}, {"length_m": 5e-3, **bent}]},
                r"guide_wire.sections.1: a wire is",
            )
            for bent in ({"steering_1_m_rad": [0.0, 9.0, 0.0]}, {"rest_curvature_1_m": [0.0, 0.0, 9.0]})
        ),
    ],
)
def test_a_mistake_in_a_guide_wire_is_one_sentence(
    tmp_path: Path, scene: dict[str, Any], catheter: dict[str, Any], wire: dict[str, Any], sentence: str
) -> None:
    path = tmp_path / "a.yaml"
    wired = {**_WIRED, **catheter}
    if wired["guide_wire"] is not None:
        wired["guide_wire"] = wire
    path.write_text(yaml.safe_dump({**_TOOLS, **scene, "catheter": wired}))
    with pytest.raises(ConfigError, match=rf"a.yaml: catheter\.{sentence}") as caught:
        load_scene(path)
    assert "\n" not in str(caught.value)


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


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("duct.membrane=opt", "duct.membrane: input should be 'cst' or 'andes'"),
        ("duct.bending=paper", "duct.bending: input should be 'auto', 'dkt', 'dkmt', 'reissner' or 'tocher'"),
    ],
)
def test_an_element_that_there_is_not_is_answered_with_those_there_are(override: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        load_scene("insertion", [override])


def test_the_exact_oscillator_is_refused_where_something_touches_the_duct(tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    file.write_text("duct: {integrator: exact}\nforceps: [{}]\n")
    with pytest.raises(ConfigError, match=r"a.yaml: duct.integrator: exact is for a duct that nothing touches"):
        load_scene(file)
    file.write_text("duct: {integrator: exact}\n")
    assert load_scene(file).duct_alone


def test_a_duct_too_short_for_its_width_is_refused_before_anything_starts(tmp_path: Path) -> None:
    """It was found by a division by zero when the rig had started; a duct alone needs no way in."""
    wide = "duct: {radius_m: 0.04, n_around: 8, n_along: 6, n_modes: 5}\n"
    path = tmp_path / "wide.yaml"
    path.write_text(f"{wide}forceps: [{{}}]\n")
    with pytest.raises(ConfigError, match=r"wide.yaml: duct: no vertex lies 2 to 3.5 radii"):
        check_duct(load_scene(path), tmp_path)
    path.write_text(wide)
    check_duct(load_scene(path), tmp_path)


SMALL_DUCT = "duct: {n_around: 8, n_along: 6, n_modes: 20}\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "duct: {n_around: 8, n_along: 6, n_modes: 500}",
            r"duct: n_modes must lie between 1 and 143, the free .* is 500",
        ),
        ("duct: {mesh_file: nowhere.stl, mesh_unit: mm}", r"duct.mesh_file: /.*nowhere.stl: no such file"),
        (
            f"{SMALL_DUCT}effects: {{large_rotations: {{n_sections: 40}}}}",
            r"effects.large_rotations: the mesh is too coarse",
        ),
        (
            f"{SMALL_DUCT}effects: {{nonlinear_membrane: {{n_coordinates: 21}}}}",
            r"effects.nonlinear_membrane: n_coordinates 21 must not be above duct.n_modes, 20",
        ),
    ],
)
def test_a_duct_that_cannot_be_built_is_a_sentence_about_its_file(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=rf"^{re.escape(str(path))}: {said}"):
        load_duct(load_scene(path), tmp_path, lambda *_: None)
