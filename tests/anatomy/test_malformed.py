"""Files that make no duct are refused with one sentence that names the file and what, or where, it is."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.anatomy.phantoms import Scan, curved, scan, straight
from tests.anatomy.volumes import image_of, write_slicer, write_volume
from trocar.services.anatomy.making import AnatomyRequest, make_anatomy
from trocar.services.meshes.errors import MeshError

SimpleITK = pytest.importorskip("SimpleITK", reason="the scan extra is not installed")

KNOWN = scan(straight(), (0.8, 0.8, 0.8))
GRID = KNOWN.origin_mm, KNOWN.spacing_mm, KNOWN.directions
Made = Callable[[Path], "Path | tuple[Path, AnatomyRequest]"]


def labelled(labels: np.ndarray) -> Scan:
    return Scan(KNOWN.tubes, labels, *GRID)


def body(inside: Callable[..., np.ndarray], size: int = 40) -> Scan:
    at = np.stack(np.meshgrid(*(np.arange(size),) * 3, indexing="ij")) - (size - 1) / 2
    return labelled(inside(*at).astype(np.uint8))


def empty(folder: Path) -> Path:
    return write_volume(labelled(np.zeros((20, 20, 20), np.uint8)), folder / "x.nrrd")


def label_without_voxels(folder: Path) -> tuple[Path, AnatomyRequest]:
    return write_slicer(KNOWN, folder / "x.seg.nrrd", {1: "Duct", 3: "Stone"}), AnatomyRequest(label="Stone")


def wrong_name(folder: Path) -> tuple[Path, AnatomyRequest]:
    return write_slicer(KNOWN, folder / "x.seg.nrrd", {1: "Cystic duct"}), AnatomyRequest(label="Cystic dust")


def wrong_number(folder: Path) -> tuple[Path, AnatomyRequest]:
    return write_volume(KNOWN, folder / "x.nii.gz"), AnatomyRequest(label="7")


def several_labels(folder: Path) -> Path:
    return write_volume(scan(straight(), (0.8, 0.8, 0.8), thickness_mm=1.0), folder / "x.nrrd")


def two_pieces(folder: Path) -> Path:
    labels = KNOWN.labels.copy()
    middle = labels.shape[0] // 2
    labels[middle - 3 : middle + 3] = 0
    return write_volume(labelled(labels), folder / "x.nrrd")


def cut_lengthwise(folder: Path) -> Path:
    along = scan(straight(), (0.6, 0.6, 0.6), directions=np.eye(3))
    half = along.labels.shape[1] // 2
    cropped = Scan(along.tubes, along.labels[:, :half], along.origin_mm, along.spacing_mm, along.directions)
    return write_volume(cropped, folder / "x.nrrd")


def image_of_floats(folder: Path) -> Path:
    values = np.random.default_rng(0).normal(size=(12, 12, 12)).astype(np.float32)
    return write_volume(KNOWN, folder / "x.nrrd", values)


def scan_in_hounsfield(folder: Path) -> Path:
    values = np.random.default_rng(0).integers(-1024, 3000, (12, 12, 12)).astype(np.int16)
    return write_volume(KNOWN, folder / "x.nii", values)


def four_dimensions(folder: Path) -> Path:
    image = SimpleITK.JoinSeries([image_of(KNOWN)] * 3)
    SimpleITK.WriteImage(image, str(folder / "x.nii.gz"))
    return folder / "x.nii.gz"


def two_dimensions(folder: Path) -> Path:
    SimpleITK.WriteImage(image_of(KNOWN)[:, :, 10], str(folder / "x.nrrd"))
    return folder / "x.nrrd"


def colours(folder: Path) -> Path:
    values = np.zeros((9, 8, 7, 3), np.uint8)
    SimpleITK.WriteImage(SimpleITK.GetImageFromArray(values, isVector=True), str(folder / "x.nrrd"))
    return folder / "x.nrrd"


def cut_off_nrrd(folder: Path) -> Path:
    return _cut(write_volume(KNOWN, folder / "x.nrrd"))


def cut_off_mha(folder: Path) -> Path:
    SimpleITK.WriteImage(image_of(KNOWN), str(folder / "x.mha"))
    return _cut(folder / "x.mha")


def cut_off_nifti(folder: Path) -> Path:
    return _cut(write_volume(KNOWN, folder / "x.nii"))


def cut_off_packed_nifti(folder: Path) -> Path:
    return _cut(write_volume(KNOWN, folder / "x.nii.gz"))


def cut_off_header(folder: Path) -> Path:
    path = write_volume(KNOWN, folder / "x.nii")
    path.write_bytes(path.read_bytes()[:100])
    return path


def _cut(path: Path) -> Path:
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) * 2 // 3])
    return path


def no_spacing_nrrd(folder: Path) -> Path:
    path = write_volume(KNOWN, folder / "x.nrrd")
    whole = re.sub(rb"space directions: [^\n]*", b"space directions: (nan,0,0) (0,1,0) (0,0,1)", path.read_bytes())
    path.write_bytes(whole)
    return path


def no_spacing_nifti(folder: Path) -> Path:
    path = write_volume(KNOWN, folder / "x.nii")
    whole = bytearray(path.read_bytes())
    whole[80:84] = np.float32(np.nan).tobytes()
    path.write_bytes(bytes(whole))
    return path


def metres_for_millimetres(folder: Path) -> Path:
    small = Scan(KNOWN.tubes, KNOWN.labels, KNOWN.origin_mm, 1e-4 * KNOWN.spacing_mm, KNOWN.directions)
    return write_volume(small, folder / "x.nrrd")


def one_voxel_thick(folder: Path) -> Path:
    labels = np.zeros((40, 20, 20), np.uint8)
    labels[4:36, 8:14, 10] = 1
    return write_volume(labelled(labels), folder / "x.nrrd")


def a_line_of_voxels(folder: Path) -> Path:
    labels = np.zeros((40, 20, 20), np.uint8)
    labels[4:36, 10, 10] = 1
    return write_volume(labelled(labels), folder / "x.nrrd")


def ball(folder: Path) -> Path:
    return write_volume(body(lambda x, y, z: x**2 + y**2 + z**2 < 15**2), folder / "x.nrrd")


def cube(folder: Path) -> Path:
    return write_volume(body(lambda x, y, z: np.maximum(np.maximum(abs(x), abs(y)), abs(z)) < 14), folder / "x.nrrd")


def ring(folder: Path) -> Path:
    return write_volume(body(lambda x, y, z: (np.hypot(x, y) - 14) ** 2 + z**2 < 4**2), folder / "x.nrrd")


def whole_volume(folder: Path) -> Path:
    return write_volume(labelled(np.ones((30, 12, 12), np.uint8)), folder / "x.nrrd")


def too_narrow(folder: Path) -> Path:
    narrow = scan(curved(), (0.5, 0.5, 0.5))
    shrunk = Scan(narrow.tubes, narrow.labels, narrow.origin_mm, 0.2 * narrow.spacing_mm, narrow.directions)
    return write_volume(shrunk, folder / "x.nrrd")


def text(folder: Path) -> Path:
    (folder / "x.nrrd").write_text("a letter\n")
    return folder / "x.nrrd"


def nothing(folder: Path) -> Path:
    (folder / "x.nii.gz").write_bytes(b"")
    return folder / "x.nii.gz"


def missing(folder: Path) -> Path:
    return folder / "x.nrrd"


def no_such_end(folder: Path) -> tuple[Path, AnatomyRequest]:
    return write_volume(KNOWN, folder / "x.nrrd"), AnatomyRequest(mouth="end_7")


def one_end_twice(folder: Path) -> tuple[Path, AnatomyRequest]:
    return write_volume(KNOWN, folder / "x.nrrd"), AnatomyRequest(mouth="end_0", held=("end_0",))


def wall_of_a_metre(folder: Path) -> tuple[Path, AnatomyRequest]:
    return write_volume(KNOWN, folder / "x.nrrd"), AnatomyRequest(thickness_m=0.9)


REFUSED: dict[Made, str] = {
    empty: "holds no label",
    label_without_voxels: "'Stone' is empty",
    wrong_name: "has no label 'Cystic dust'; it has 1 .Cystic duct.; did you mean 'Cystic duct'",
    wrong_number: "has no label '7'; it has 1",
    several_labels: "say which label is the duct's, it has 1, 2",
    two_pieces: r"in 2 pieces, the second with \d+ % of it round \[.*\] mm",
    cut_lengthwise: r"cut off lengthwise .*\[.*\] mm",
    image_of_floats: r"is an image and no labels: voxel \(0, 0, 0\) has the value",
    scan_in_hounsfield: "is an image and no labels: it has .* different values from -",
    four_dimensions: "has 4 dimensions",
    two_dimensions: "has 2 dimensions",
    colours: "each voxel has 3 values",
    cut_off_nrrd: "not a readable volume",
    cut_off_mha: "not a readable volume",
    cut_off_nifti: "the file is cut off, it announces .* bytes",
    cut_off_packed_nifti: "the file is cut off or broken",
    cut_off_header: "the file is cut off",
    no_spacing_nrrd: "'space directions' holds no number",
    no_spacing_nifti: "voxel sizes are .nan",
    metres_for_millimetres: "the spacing along i is 8e-05 mm",
    one_voxel_thick: r"nowhere thicker than two voxels, round \[.*\] mm",
    a_line_of_voxels: r"nowhere thicker than two voxels, round \[.*\] mm",
    ball: r"closed body without openings round \[.*\] mm",
    cube: r"closed body without openings round \[.*\] mm",
    ring: r"closed ring, .* round \[.*\] mm",
    whole_volume: r"cut off lengthwise .*\[.*\] mm",
    too_narrow: r"the lumen is .* mm wide at \[.*\] mm",
    text: "not a readable volume",
    nothing: "the file is empty",
    missing: "no such file",
    no_such_end: "has no end 'end_7'; it has end_0 at",
    one_end_twice: "'end_0' cannot be the mouth and held",
    wall_of_a_metre: "a wall of 900 mm .as said. is no duct's",
}


@pytest.mark.parametrize("make", REFUSED, ids=lambda make: make.__name__)
def test_it_is_refused_in_one_sentence(make: Made, tmp_path: Path) -> None:
    made = make(tmp_path)
    path, request = made if isinstance(made, tuple) else (made, AnatomyRequest())
    with pytest.raises(MeshError, match=REFUSED[make]) as refused:
        make_anatomy(path, request)
    sentence = str(refused.value)
    assert sentence.startswith(f"{path}: ")
    assert "\n" not in sentence
    assert sentence.count(str(path)) == 1
    assert len(sentence) - len(str(path)) < 320
