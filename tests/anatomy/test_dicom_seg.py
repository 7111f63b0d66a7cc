"""DICOM segmentations lie in the patient where the same label lies as a volume."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.anatomy.phantoms import curved, scan
from tests.anatomy.volumes import _slices, write_dicom_seg, write_volume
from trocar.services.anatomy.making import AnatomyRequest, make_anatomy
from trocar.services.anatomy.volume import read_volume
from trocar.services.meshes.errors import MeshError

pytest.importorskip("highdicom", reason="the scan extra is not installed")
pytest.importorskip("SimpleITK", reason="the scan extra is not installed")

KNOWN = scan(curved(), (0.6, 0.6, 0.9), thickness_mm=0.9)


def test_a_segment_is_read_where_it_lies(tmp_path: Path) -> None:
    by_dicom = read_volume(write_dicom_seg(KNOWN, tmp_path / "duct.dcm", {1: "Lumen", 2: "Wall"}), "Lumen", "Wall")
    by_nrrd = read_volume(write_volume(KNOWN, tmp_path / "duct.nrrd"), "1", "2")
    places = [np.sort(v.place_m(np.argwhere(v.mask)).round(6), axis=0) for v in (by_dicom, by_nrrd)]
    assert places[0] == pytest.approx(places[1], abs=2e-6)
    assert by_dicom.wall.sum() == by_nrrd.wall.sum() > 0
    assert by_dicom.labels == ["Lumen", "Wall"]


def test_it_becomes_a_duct(tmp_path: Path) -> None:
    path = write_dicom_seg(KNOWN, tmp_path / "duct", {1: "Lumen", 2: "Wall"})
    anatomy = make_anatomy(path, AnatomyRequest(label="lumen", wall="wall"))
    assert np.percentile(KNOWN.surface_error_mm(anatomy.surface.mesh.vertices_m), 95.0) < 0.35
    assert anatomy.wall.thickness_m == pytest.approx(0.9e-3, abs=0.15e-3)


def test_a_slice_of_the_scan_itself_is_refused(tmp_path: Path) -> None:
    import pydicom

    one = _slices(KNOWN)[0]
    path = tmp_path / "slice.dcm"
    pydicom.dcmwrite(path, one, enforce_file_format=True)
    with pytest.raises(MeshError, match="is CT Image Storage, not a segmentation"):
        make_anatomy(path, AnatomyRequest())
