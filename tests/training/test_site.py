"""Where the mouth is, from the duct that a recording carries, against what the mechanics say of the same duct."""

from __future__ import annotations

import io
import shutil
from pathlib import Path

import numpy as np
import pytest

from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.surface.opening import mouth_opening
from trocar.services.runtime.config import scene_findings
from trocar.services.runtime.errors import ConfigError
from trocar.services.scenes import load_duct, load_scene
from trocar.services.scenes.duct_file import duct_file
from trocar.services.training.site import Site, find_site, read_site
from trocar.services.visualization.cameras import place
from trocar.services.visualization.picture import PictureLayout


@pytest.fixture(scope="module")
def duct() -> ReducedDuct:
    return load_duct(load_scene("insertion"), cache_directory(), lambda stage, fraction: None)


def attached(**arrays: object) -> bytes:
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()


def site_of(duct: ReducedDuct) -> Site:
    return read_site(duct_file(duct))


def test_the_mouth_is_the_open_end_that_moves(duct: ReducedDuct) -> None:
    site, opening = site_of(duct), mouth_opening(duct.mesh)
    np.testing.assert_allclose(site.mouth_m, opening.centre_m, atol=1e-12)
    np.testing.assert_allclose(site.inward, opening.inward, atol=1e-12)
    assert site.mouth_radius_m == pytest.approx(opening.radius_m)
    assert site.basis_hash == duct.basis.content_hash


def test_the_rim_gain_is_the_mean_way_outwards(duct: ReducedDuct) -> None:
    site = site_of(duct)
    rim = duct.mesh.vertices_m[duct.mesh.vertex_sets["mouth"]]
    out = rim - rim.mean(axis=0)
    q = np.random.default_rng(9).standard_normal(len(site.rim_gain))
    moved = np.einsum("ijm,m->ij", np.asarray(duct.basis.Phi)[duct.mesh.vertex_sets["mouth"]], q)
    mean_m = np.einsum("ij,ij->i", moved, out / np.linalg.norm(out, axis=1)[:, None]).mean()
    assert np.dot(site.rim_gain, q) == pytest.approx(mean_m, rel=1e-4)


def test_the_eye_is_that_of_the_page_where_the_duct_is_straight(duct: ReducedDuct) -> None:
    site, mesh = site_of(duct), duct.mesh
    ends = (tuple(mesh.vertex_sets[name].tolist()) for name in ("mouth", "clamped"))
    rest_m = mesh.vertices_m.astype(np.float32)
    view = place(PictureLayout(1, "insertion", rest_m, mesh.triangles, 1e-3, *ends, 40, 1e-3, ()), "scope")
    np.testing.assert_allclose(np.array(site.eye_m), view.position_m, atol=1e-6)
    np.testing.assert_allclose(np.array(site.looks_at_m), view.aim_m, atol=1e-6)


@pytest.mark.parametrize(
    ("data", "says"),
    [(b"nonsense", "duct.npz cannot be read"), (attached(vertices_m=np.zeros((3, 3))), "duct.npz cannot be read")],
)
def test_what_is_no_duct_is_refused(data: bytes, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        read_site(data)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("triangles", np.array([[0, 1, 9]])),
        ("triangles", np.array([[0.0, 1.0, 2.0]])),
        ("triangles", np.zeros((0, 3), int)),
        ("vertices_m", np.zeros(4)),
        ("vertices_m", np.full((4, 3), np.nan)),
        ("modes", np.zeros((3, 3, 2))),
    ],
)
def test_arrays_that_are_no_surface_are_refused(name: str, value: object) -> None:
    arrays = {
        "vertices_m": np.eye(4, 3),
        "triangles": np.array([[0, 1, 2]]),
        "modes": np.ones((4, 3, 2)),
        "basis_hash": "",
    }
    with pytest.raises(ValueError, match=r"duct.npz: its arrays"):
        read_site(attached(**arrays | {name: value}))


def test_a_duct_without_an_open_end_that_moves_is_refused() -> None:
    modes = np.zeros((4, 3, 2))
    arrays = {
        "vertices_m": np.eye(4, 3),
        "triangles": np.array([[0, 1, 2], [0, 2, 3]]),
        "modes": modes,
        "basis_hash": "",
    }
    with pytest.raises(ValueError, match="no open end that moves"):
        read_site(attached(**arrays))


def test_a_live_judge_finds_the_same_site_once_and_anew_where_that_basis_is_gone(
    duct: ReducedDuct, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    shutil.copytree(cache_directory() / "bases", tmp_path / "bases", ignore=shutil.ignore_patterns(".*", "residual-*"))
    monkeypatch.setenv("TROCAR_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(scene_findings, "_found", lambda *_: duct_file(duct))
    assert find_site("insertion") == site_of(duct)
    monkeypatch.setattr(scene_findings, "_found", lambda *_: b"")
    assert find_site("insertion") == site_of(duct)
    shutil.rmtree(tmp_path / "bases")
    with pytest.raises(ConfigError, match=r"insertion: duct\.npz"):
        find_site("insertion")


def test_a_live_judge_finds_the_site_in_a_process_of_its_own(duct: ReducedDuct) -> None:
    assert find_site("insertion") == site_of(duct)
    with pytest.raises(ConfigError, match="there is no scene 'nonsense'"):
        find_site("nonsense")
