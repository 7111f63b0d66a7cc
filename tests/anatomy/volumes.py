"""Scans written as the formats in which hospitals keep segmentations."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.anatomy.phantoms import Scan


def image_of(scan: Scan, labels: np.ndarray | None = None):
    import SimpleITK

    array = scan.labels if labels is None else labels
    image = SimpleITK.GetImageFromArray(np.ascontiguousarray(array.transpose()))
    image.SetOrigin(scan.origin_mm.tolist())
    image.SetSpacing(scan.spacing_mm.tolist())
    image.SetDirection(scan.directions.ravel().tolist())
    return image


def write_volume(scan: Scan, path: Path, labels: np.ndarray | None = None) -> Path:
    import SimpleITK

    SimpleITK.WriteImage(image_of(scan, labels), str(path), useCompression=True)
    return path


def write_slicer(scan: Scan, path: Path, names: dict[int, str]) -> Path:
    """Write a `.seg.nrrd` as 3D Slicer does, all segments in one layer."""
    import SimpleITK

    image = image_of(scan)
    for k, (value, name) in enumerate(names.items()):
        for key, said in {"ID": f"Segment_{k}", "Name": name, "LabelValue": str(value), "Layer": "0"}.items():
            image.SetMetaData(f"Segment{k}_{key}", said)
    image.SetMetaData("Segmentation_SourceRepresentation", "Binary labelmap")
    SimpleITK.WriteImage(image, str(path), useCompression=True)
    return path


def write_dicom_seg(scan: Scan, path: Path, names: dict[int, str]) -> Path:
    """Write a DICOM segmentation, a segment for each label, over slices of an empty scan."""
    import highdicom
    from pydicom.sr.codedict import codes

    slices = _slices(scan)
    described = [
        highdicom.seg.SegmentDescription(
            segment_number=k + 1, segment_label=name, segmented_property_category=codes.SCT.Organ,
            segmented_property_type=codes.SCT.BileDuct, algorithm_type=highdicom.seg.SegmentAlgorithmTypeValues.MANUAL,
        )
        for k, name in enumerate(names.values())
    ]  # fmt: skip
    frames = np.stack([scan.labels == value for value in names], axis=-1).transpose(2, 1, 0, 3).astype(np.uint8)
    seg = highdicom.seg.Segmentation(
        source_images=slices, pixel_array=frames, segmentation_type=highdicom.seg.SegmentationTypeValues.BINARY,
        segment_descriptions=described, series_instance_uid=highdicom.UID(), series_number=2,
        sop_instance_uid=highdicom.UID(), instance_number=1, manufacturer="test", manufacturer_model_name="test",
        software_versions="1", device_serial_number="1",
    )  # fmt: skip
    seg.save_as(path)
    return path


def _slices(scan: Scan) -> list:
    """Return empty CT slices on the grid of a scan."""
    import pydicom
    from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian, generate_uid

    series, study, frame = generate_uid(), generate_uid(), generate_uid()
    ni, nj, nk = scan.labels.shape
    i, j, k = scan.directions.T
    made = []
    for number in range(nk):
        one = pydicom.Dataset()
        one.file_meta = pydicom.dataset.FileMetaDataset()
        one.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
        one.SOPClassUID, one.SOPInstanceUID = CTImageStorage, generate_uid()
        one.SeriesInstanceUID, one.StudyInstanceUID, one.FrameOfReferenceUID = series, study, frame
        one.Modality, one.PatientID, one.PatientName, one.PatientBirthDate, one.PatientSex = "CT", "1", "A^B", "", "O"
        one.StudyID, one.StudyDate, one.StudyTime, one.AccessionNumber = "1", "20260101", "000000", ""
        one.ReferringPhysicianName, one.PositionReferenceIndicator = "", ""
        one.SeriesNumber, one.InstanceNumber = 1, number + 1
        one.Columns, one.Rows, one.SamplesPerPixel, one.PhotometricInterpretation = ni, nj, 1, "MONOCHROME2"
        one.BitsAllocated, one.BitsStored, one.HighBit, one.PixelRepresentation = 16, 16, 15, 0
        one.ImageOrientationPatient = [*i.tolist(), *j.tolist()]
        one.ImagePositionPatient = (scan.origin_mm + number * scan.spacing_mm[2] * k).tolist()
        one.PixelSpacing = [float(scan.spacing_mm[1]), float(scan.spacing_mm[0])]
        one.SliceThickness = float(scan.spacing_mm[2])
        one.PixelData = np.zeros((nj, ni), np.uint16).tobytes()
        made.append(one)
    return made
