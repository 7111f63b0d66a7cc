"""Scene files that are refused: one table of what is written, and of the sentence about it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.refusals import assert_refused
from trocar.services.scenes import check_duct, load_duct, load_scene

_WIRED = {"anchor": "introducer", "inner_diameter_m": 1e-3, "outer_diameter_m": 2e-3, "guide_wire": {}}
_TOOLS = {"forceps": [{"kind": "drive"}, {"kind": "wire_drive"}], "hands": "drive", "effects": {"twist": {}}}


def _wired(scene: dict[str, Any], catheter: dict[str, Any], wire: dict[str, Any], sentence: str) -> tuple[str, str]:
    """Return a sound scene with a guide wire in which this is changed, and the sentence about its catheter."""
    wired = {**_WIRED, **catheter}
    if wired["guide_wire"] is not None:
        wired["guide_wire"] = wire
    return yaml.safe_dump({**_TOOLS, **scene, "catheter": wired}), rf"a.yaml: catheter\.{sentence}"


#: The file's text, and a pattern of the sentence.
FILES = [
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
    ("catheter: {bubbles: [{radius_m: 0}]}", r"a.yaml: catheter.bubbles.0.radius_m: must be positive"),
    ("catheter: {bubbles: [{radius_m: 1, after_m3: -1}]}", r"catheter.bubbles.0.after_m3: must not be negative"),
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
    ("duct: {membrane: opt}", r"duct.membrane: input should be 'cst' or 'andes'"),
    ("duct: {bending: paper}", r"duct.bending: input should be 'auto', 'dkt', 'dkmt', 'reissner' or 'tocher'"),
    (
        "duct: {integrator: exact}\nforceps: [{}]",
        r"a.yaml: duct.integrator: exact is for a duct that nothing touches",
    ),
    ("{forceps: [{}, {}], hands: drive}", r"hands: drive needs a tool of kind drive"),
    # Cells that the rule of `auto` cannot find.
    ("duct: {n_around: auto, radius_m: wide}", "a.yaml: duct.radius_m"),
    ("duct: {n_around: auto, length_m: -1.0}", "a.yaml: duct.length_m: must be positive"),
    ("duct: {n_around: auto, length_m: 1.0e+308}", "a.yaml: duct.length_m: must not be above"),
    ("duct: {n_along: auto, radius_m: 1" + "0" * 400 + "}", "a.yaml: line 1, column 33"),
    ("{duct: {n_along: auto, radius_m: 1.0e-200}, forceps: [{jaw_radius_m: 1.0e-200}]}", "a.yaml: duct"),
    ("duct: {n_around: automatic}", "a.yaml: duct.n_around"),
    ("duct: auto", "a.yaml: duct"),
    ("{duct: {n_along: auto}, forceps: [{jaw_radius_m: thin}]}", "a.yaml: forceps.0.jaw_radius_m"),
    ("{duct: {n_along: auto}, forceps: 3}", "a.yaml: forceps"),
    # Catheters and wires as sold.
    *(
        (yaml.safe_dump({"catheter": catheter, "effects": {"twist": {}}}), sentence)
        for catheter, sentence in (
            ({"product": "cholangiography_6fr"}, "catheter.product: there is no catheter 'cholangiography_6fr'"),
            ({"product": "wire_035_amplatz"}, "catheter.product: 'wire_035_amplatz' is a guide_wire, not a catheter"),
            (
                {"guide_wire": {"product": "cholangiography_5fr"}},
                "guide_wire.product: .* is a catheter, not a guide_wire",
            ),
            ({"product": 5}, "catheter.product"),
        )
    ),
    # A guide wire in the catheter.
    _wired({"forceps": [{"kind": "drive"}]}, {}, {}, r"guide_wire: goes with one tool of kind wire_drive"),
    _wired({}, {"guide_wire": None}, {}, r"guide_wire: goes with one tool of kind wire_drive, and that with it"),
    _wired({"effects": {}}, {}, {}, r"guide_wire: turns in the catheter, name the effect 'twist' too"),
    _wired({}, {"anchor": "free"}, {}, r"guide_wire: needs a catheter with anchor introducer and integrator"),
    _wired({}, {"integrator": "semi_implicit"}, {}, r"guide_wire: needs .* and integrator implicit"),
    *(
        _wired({"effects": {"twist": {}, name: {}}}, {}, {}, rf"guide_wire: the effect '{name}' knows a cath")
        for name in ("gravity", "mucus_drag", "self_contact")
    ),
    _wired(
        {}, {"inner_diameter_m": 0.7e-3}, {}, r"guide_wire.outer_diameter_m: must be below the catheter's inner_diam"
    ),
    _wired({}, {}, {"poisson_ratio": 0.6}, r"guide_wire.poisson_ratio: must lie above -1 and not above 0.5, is 0.6"),
    _wired({}, {}, {"out_m": 4e-3}, r"guide_wire.out_m: must lie within least_out_m and reach_m, .*, is 0.004"),
    _wired({}, {}, {"out_m": 41e-3}, r"guide_wire.out_m: must lie within least_out_m and reach_m, .*, is 0.041"),
    _wired({}, {}, {"reach_m": 0.2}, r"guide_wire.out_m: must lie .*, that below the catheter's length"),
    _wired({}, {}, {"friction": -0.1}, r"guide_wire.friction: must not be negative, is -0.1"),
    *(
        _wired({}, {}, {name: 0.0}, rf"guide_wire.{name}: must be positive, is 0")
        for name in ("outer_diameter_m", "youngs_modulus_pa", "density_kg_m3", "out_m", "least_out_m", "reach_m")
    ),
    _wired({}, {}, {"sections": [{"length_m": 0.0}]}, r"guide_wire.sections.0.length_m: must be positive, is 0"),
    *(
        _wired(
            {},
            {},
            {"sections": [{"length_m": 5e-3}, {"length_m": 5e-3, **bent}]},
            r"guide_wire.sections.1: a wire is",
        )
        for bent in ({"steering_1_m_rad": [0.0, 9.0, 0.0]}, {"rest_curvature_1_m": [0.0, 0.0, 9.0]})
    ),
]

_SMALL_DUCT = "duct: {n_around: 8, n_along: 6, n_modes: 20}\n"

#: Scenes whose duct cannot be built, likewise.
DUCTS = [
    (
        "duct: {n_around: 8, n_along: 6, n_modes: 500}",
        r"duct: n_modes must lie between 1 and 143, the free .* is 500",
    ),
    ("duct: {mesh_file: nowhere.stl, mesh_unit: mm}", r"duct.mesh_file: /.*nowhere.stl: no such file"),
    (
        f"{_SMALL_DUCT}effects: {{large_rotations: {{n_sections: 40}}}}",
        r"effects.large_rotations: the mesh is too coarse",
    ),
    (
        f"{_SMALL_DUCT}effects: {{nonlinear_membrane: {{n_coordinates: 21}}}}",
        r"effects.nonlinear_membrane: n_coordinates 21 must not be above duct.n_modes, 20",
    ),
]


@pytest.mark.parametrize(("text", "sentence"), FILES)
def test_a_mistake_in_a_scene_is_one_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    assert_refused(load_scene, tmp_path / "a.yaml", text, sentence)


@pytest.mark.parametrize(("text", "sentence"), DUCTS)
def test_a_duct_that_cannot_be_built_is_a_sentence_about_its_file(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "a.yaml"
    assert_refused(
        lambda file: load_duct(load_scene(file), tmp_path, lambda *_: None), path, text,
        rf"^{re.escape(str(path))}: {sentence}",
    )  # fmt: skip


def test_a_duct_too_short_for_its_width_is_refused_before_anything_starts(tmp_path: Path) -> None:
    """It was found by a division by zero when the rig had started; a duct alone needs no way in."""
    wide, path = "duct: {radius_m: 0.04, n_around: 8, n_along: 6, n_modes: 5}\n", tmp_path / "a.yaml"
    assert_refused(
        lambda file: check_duct(load_scene(file), tmp_path), path, f"{wide}forceps: [{{}}]\n",
        r"a.yaml: duct: no vertex lies 2 to 3.5 radii",
    )  # fmt: skip
    path.write_text(wide)
    check_duct(load_scene(path), tmp_path)


def test_the_exact_oscillator_is_taken_where_nothing_touches_the_duct(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("duct: {integrator: exact}\n")
    assert load_scene(tmp_path / "a.yaml").duct_alone
