"""Volumes of known ducts become surfaces, centrelines and ends that are those of the ducts."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from tests.anatomy.phantoms import Scan, curved, forked, s_shaped, scan, straight
from tests.anatomy.volumes import write_layers, write_slicer, write_volume
from trocar.services.anatomy.making import AnatomyRequest, MadeAnatomy, make_anatomy
from trocar.services.anatomy.volume import read_volume
from trocar.services.mechanics.surface.branched_tubes import Tube

pytest.importorskip("SimpleITK", reason="the scan extra is not installed")


@dataclass(frozen=True)
class Case:
    tubes: Callable[[], list[Tube]]
    spacing_mm: tuple[float, float, float]
    noise_mm: float = 0.0
    directions: np.ndarray | None = None


CASES = {
    "straight, fine": Case(straight, (0.3, 0.3, 0.3), directions=np.eye(3)),
    "straight, coarse": Case(straight, (1.0, 1.0, 1.0)),
    "curved, noisy": Case(curved, (0.6, 0.6, 0.6), 0.2),
    "S, flat voxels": Case(s_shaped, (0.4, 0.4, 1.0), 0.1),
    "fork, fine": Case(forked, (0.4, 0.4, 0.4), 0.1),
    "fork, flat voxels": Case(forked, (0.5, 0.5, 1.0)),
    "mirrored axes": Case(curved, (0.6, 0.6, 0.6), directions=np.diag([-1.0, -1.0, 1.0])),
    "left-handed axes": Case(curved, (0.6, 0.6, 0.6), directions=np.diag([1.0, 1.0, -1.0])),
}
FORK_RADII = 2.0
"""So near to a fork, in radii of the wider tube, there is no one middle: two axes meet in a point."""


@pytest.fixture(scope="module", params=CASES, ids=list(CASES))
def made(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Scan, MadeAnatomy]:
    case = CASES[request.param]
    known = {} if case.directions is None else {"directions": case.directions}
    known_scan = scan(case.tubes(), case.spacing_mm, noise_mm=case.noise_mm, **known)
    path = write_volume(known_scan, tmp_path_factory.mktemp("scan") / "duct.nii.gz")
    return known_scan, make_anatomy(path, AnatomyRequest(label="1"))


def test_the_surface_is_the_ducts_within_half_a_voxel(made: tuple[Scan, MadeAnatomy]) -> None:
    known, anatomy = made
    error_mm = known.surface_error_mm(anatomy.surface.mesh.vertices_m)
    assert np.percentile(error_mm, 95.0) < 0.5 * float(np.cbrt(known.spacing_mm.prod()))


def test_the_shell_lies_half_a_wall_outside_it(made: tuple[Scan, MadeAnatomy]) -> None:
    known, anatomy = made
    outside_mm = 0.5e3 * anatomy.wall.thickness_m
    off_mm = np.abs(known.surface_error_mm(anatomy.duct.mesh.vertices_m) - outside_mm)
    assert np.percentile(off_mm, 95.0) < 0.5 * known.spacing_mm.max()


def test_the_centreline_is_the_ducts_within_a_voxel(made: tuple[Scan, MadeAnatomy]) -> None:
    known, anatomy = made
    points = np.concatenate([line.points_m for line in anatomy.duct.lines])
    for tube in known.tubes[1:]:
        points = points[np.linalg.norm(points - tube.origin_m, axis=1) > FORK_RADII * known.tubes[0].radius_m]
    assert known.axis_error_mm(points).max() < known.spacing_mm.max()


def test_each_end_is_open_and_square(made: tuple[Scan, MadeAnatomy]) -> None:
    known, anatomy = made
    tubes = known.tubes
    goes_on = np.allclose(tubes[-1].origin_m, tubes[0].place(tubes[0].length_m)[0])
    ends = [(tubes[0].origin_m, -tubes[0].axes[0])]
    for tube in tubes[1:] if goes_on else tubes:
        middle_m, axes = tube.place(tube.length_m)
        ends.append((middle_m, axes[0]))
    assert len(anatomy.duct.ends) == len(ends)
    for middle_m, outward in ends:
        nearest = min(anatomy.duct.ends, key=lambda e: float(np.linalg.norm(e.opening.centre_m - middle_m)))
        assert np.linalg.norm(nearest.opening.centre_m - middle_m) < 2.0 * tubes[0].radius_m
        assert np.degrees(np.arccos(min(1.0, float(nearest.opening.direction @ outward)))) < 12.0


def test_a_place_in_the_patient_is_found_in_the_scene(made: tuple[Scan, MadeAnatomy]) -> None:
    _, anatomy = made
    back = anatomy.placed.vertices_m @ anatomy.axes + anatomy.origin_m
    assert back == pytest.approx(anatomy.duct.mesh.vertices_m, abs=1e-12)
    assert np.linalg.det(anatomy.axes) == pytest.approx(1.0)
    assert anatomy.axes[2] @ [0.0, -1.0, 0.0] >= 0.0


def test_the_wall_is_measured_from_its_label(tmp_path: Path) -> None:
    known = scan(curved(), (0.4, 0.4, 0.4), thickness_mm=0.8)
    path = write_slicer(known, tmp_path / "duct.seg.nrrd", {1: "Cystic duct", 2: "Wall"})
    wall = make_anatomy(path, AnatomyRequest(label="cystic duct", wall="Wall")).wall
    assert wall.thickness_m == pytest.approx(0.8e-3, abs=0.1e-3)
    assert wall.spread_m is not None
    assert 0.5e-3 < wall.spread_m[0] < wall.thickness_m < wall.spread_m[1] < 1.1e-3


def test_an_end_has_the_name_of_the_segment_it_borders_on(tmp_path: Path) -> None:
    known = scan(straight(), (0.6, 0.6, 0.6), directions=np.eye(3))
    beyond = np.argwhere(known.labels == 1)[:, 0].max() + 1
    known.labels[beyond:] = 2
    path = write_slicer(known, tmp_path / "duct.seg.nrrd", {1: "Cystic duct", 2: "Gall bladder"})
    anatomy = make_anatomy(path, AnatomyRequest(label="Cystic duct"))
    assert {end.name for end in anatomy.duct.ends} == {"gall_bladder", "end_0"}
    assert anatomy.choice.mouth == "gall_bladder"


def test_a_vessel_that_leaves_the_volume_is_cut_square_inside_it(tmp_path: Path) -> None:
    known = scan(straight(), (0.6, 0.6, 0.6))
    held = np.argwhere(known.labels == 1)
    at = int(held[:, 0].max()) - 8
    cropped = Scan(known.tubes, known.labels[:at], known.origin_mm, known.spacing_mm, known.directions)
    anatomy = make_anatomy(write_volume(cropped, tmp_path / "duct.nrrd"), AnatomyRequest())
    for end in anatomy.duct.ends:
        assert abs(end.opening.direction[0]) > np.cos(np.radians(12.0))


def test_the_same_label_by_every_format_is_the_same_surface(tmp_path: Path) -> None:
    known = scan(curved(), (0.8, 0.8, 0.8))
    paths = [write_volume(known, tmp_path / f"duct{ending}") for ending in (".nrrd", ".nii", ".nii.gz", ".mha")]
    paths.append(write_volume(known, tmp_path / "float.nrrd", known.labels.astype(np.float32)))
    surfaces = [make_anatomy(path, AnatomyRequest(label="1")).surface.mesh for path in paths]
    for other in surfaces[1:]:
        assert other.vertices_m == pytest.approx(surfaces[0].vertices_m, abs=1e-8)  # NIfTI has axes in single precision


def test_segments_that_overlap_are_told_apart(tmp_path: Path) -> None:
    known = scan(curved(), (0.8, 0.8, 0.8))
    other = Scan(known.tubes, np.roll(known.labels, 3, axis=1), known.origin_mm, known.spacing_mm, known.directions)
    path = write_layers([other, known], tmp_path / "duct.seg.nrrd", ["Vein", "Duct"])
    volume = read_volume(path, "Duct", None)
    assert volume.mask.sum() == known.labels.sum()
    assert volume.labels == ["Vein", "Duct"]
    assert known.surface_error_mm(volume.place_m(np.argwhere(volume.mask))).max() < 3.0
    assert (volume.beside[volume.mask] > 0).any()


def test_the_report_can_be_read_by_machines(tmp_path: Path, made: tuple[Scan, MadeAnatomy]) -> None:
    from trocar.services.anatomy.scene_folder import write_folder

    write_folder(made[1], tmp_path)
    told = json.loads((tmp_path / "report.json").read_text())
    assert told["moved"]["surface_from_voxel_faces_mm"][1] < 1.0 * float(made[0].spacing_mm.max())
    assert {end["is"] for end in told["ends"]} == {"mouth", "held"}
