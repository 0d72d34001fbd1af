"""DICOM files as scanners and screens write them."""

from __future__ import annotations

import numpy as np
from bones import write_dicom
from drawing import blend, coverage, flat, to_uint8, wavy
from pydicom.uid import SecondaryCaptureImageStorage

SHAPE = (150, 220)


CURVE = wavy(SHAPE, 4, margin=0.25)


PICTURE = to_uint8(blend(flat(SHAPE, 180), coverage(SHAPE, CURVE, 3), (230, 20, 40)))


def capture(tmp_path, pixels=PICTURE, kind="RGB", **more):
    """A secondary capture as a DICOM file."""
    is_many = pixels.ndim == 4
    bits = 8 * pixels.itemsize
    about = {
        "Rows": pixels.shape[is_many], "Columns": pixels.shape[is_many + 1], "SamplesPerPixel": 1,
        "PhotometricInterpretation": kind, "BitsAllocated": bits, "BitsStored": bits,
        "HighBit": bits - 1, "PixelRepresentation": int(pixels.dtype.kind == "i"),
        "PixelData": pixels.tobytes(),
    }  # fmt: skip
    if kind in ("RGB", "YBR_FULL"):
        about |= {"SamplesPerPixel": pixels.shape[-1], "PlanarConfiguration": 0}
    if is_many:
        about["NumberOfFrames"] = len(pixels)
    path = tmp_path / "slice.dcm"
    return write_dicom(path, SecondaryCaptureImageStorage, "1.2.3.4", "OT", **about | more)


def ct_series(folder):
    """A folder of CT slices 3 mm apart, 100 greys brighter a slice; their names are in no order."""
    folder.mkdir()
    noise = np.random.default_rng(0).integers(0, 50, (*SHAPE, 1))
    for number in (1, 2):
        for k in range(7 - number):
            about = {
                "SeriesInstanceUID": f"1.2.{number}", "SeriesNumber": number, "Modality": "CT",
                "PixelSpacing": [0.5, 0.5], "ImagePositionPatient": [0, 0, 3.0 * k],
                "ImageOrientationPatient": [1, 0, 0, 0, 1, 0],
            }  # fmt: skip
            path = capture(folder, (100 * k + noise).astype(np.uint16), "MONOCHROME2", **about)
            path.rename(folder / f"{number}-{5 * k % 7}-{k}.dcm")
    return folder
