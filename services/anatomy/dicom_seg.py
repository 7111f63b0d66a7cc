"""Labels from DICOM Segmentation objects, by highdicom."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from trocar.services.anatomy.volume_file import Volume, judge_size
from trocar.services.meshes.errors import MeshError

_SEGMENTATION = "1.2.840.10008.5.1.4.1.1.66.4"


def read_dicom_seg(path: Path) -> Volume:
    """Read a segmentation of a volume; each segment becomes a layer.

    Raises MeshError if the object is another one, or has no slices at equal distances.
    """
    import highdicom
    import pydicom

    head = pydicom.dcmread(path, stop_before_pixels=True)
    if str(head.get("SOPClassUID", "")) != _SEGMENTATION:
        kind = getattr(head.get("SOPClassUID"), "name", "no object of DICOM")
        raise MeshError(f"{path}: is {kind}, not a segmentation: segment it first, in 3D Slicer for instance")
    seg = highdicom.seg.segread(path)
    geometry = seg.get_volume_geometry()
    if geometry is None:
        raise MeshError(f"{path}: its slices lie at no equal distances, and make no volume")
    judge_size(path, geometry.spatial_shape)
    numbers = list(seg.segment_numbers)
    volume = seg.get_volume(segment_numbers=numbers, combine_segments=False, rescale_fractional=False)
    names = {(k, number): seg.get_segment_description(number).segment_label for k, number in enumerate(numbers)}
    axes = np.asarray(volume.affine)[:3, :3]  # LPS
    spacing = np.linalg.norm(axes, axis=0)
    layers = [(volume.array[..., k] > 0).astype(np.uint16) * np.uint16(number) for k, number in enumerate(numbers)]
    return Volume(layers, np.asarray(volume.affine)[:3, 3], spacing, axes / spacing, names)
