"""Bones with a closed form, their outlines on slices, and the files that tools export of them.

Lengths in millimetres, as the files have them.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from slicer_files import SCHEMA

EVEN = np.linspace(0, 2 * np.pi, 400, endpoint=False)


@dataclass(frozen=True)
class Bone:
    """`level(points (M, 3))` is below 0 inside; `rings(z)` are its outlines on the slice at z."""

    level: Callable
    rings: Callable
    low: float
    high: float

    def distance(self, points):
        """(M,) signed distance of points near the surface, to first order [mm]."""
        step = 1e-4
        gradient = [
            (self.level(points + step * e) - self.level(points - step * e)) / (2 * step)
            for e in np.eye(3)
        ]
        return self.level(points) / np.linalg.norm(gradient, axis=0)

    def places(self, gap):
        return np.arange(self.low, self.high + 1e-9, gap)


def ring(centre, radii):
    return np.c_[centre[0] + radii[0] * np.cos(EVEN), centre[1] + radii[1] * np.sin(EVEN)]


HALVES = np.array([18.0, 14.0, 45.0])


def _bend(z):
    return 8 * (z / 40) ** 2


def _ellipsoid(points):
    moved = points - np.c_[_bend(points[:, 2]), np.zeros((len(points), 2))]
    return np.sqrt(((moved / HALVES) ** 2).sum(axis=1)) - 1


def _ellipsoid_rings(z):
    size = np.sqrt(1 - (z / HALVES[2]) ** 2)
    return [ring((_bend(z), 0), HALVES[:2] * size)]


BENT = Bone(_ellipsoid, _ellipsoid_rings, -38, 37)


def _hole(points):
    return np.hypot(points[:, 0] - _bend(points[:, 2]), points[:, 1] - 2) - 4


TUNNEL = Bone(
    lambda p: np.maximum(_ellipsoid(p) * 14, -_hole(p)),
    lambda z: [*_ellipsoid_rings(z), ring((_bend(z), 2), (4, 4))],
    -30,
    30,
)


def _legs(z):
    return 11 + 0.006 * z * z


def _two(points):
    x = np.abs(points[:, 0]) - _legs(points[:, 2])
    return np.hypot(x, points[:, 1]) - 8


BRANCHES = Bone(_two, lambda z: [ring((s * _legs(z), 0), (8, 8)) for s in (-1, 1)], -25, 25)


def outlines(bone, gap):
    """(ring (M, 2), z) of every slice of a bone, `gap` apart."""
    return [(r, z) for z in bone.places(gap) for r in bone.rings(z)]


def identity(points):
    return points


def item(**values):
    """A data set of these elements."""
    from pydicom.dataset import Dataset

    made = Dataset()
    for name, value in values.items():
        setattr(made, name, value)
    return made


def write_dicom(path, kind, instance, modality, preamble=True, **values):
    """A DICOM file of this SOP class with these elements."""
    from pydicom.dataset import FileMetaDataset
    from pydicom.uid import ExplicitVRLittleEndian

    about = {"SOPClassUID": kind, "SOPInstanceUID": instance, "Modality": modality}
    data = item(**about | values)
    data.file_meta = meta = FileMetaDataset()
    meta.TransferSyntaxUID = ExplicitVRLittleEndian
    meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID = kind, instance
    data.save_as(path, enforce_file_format=preamble, implicit_vr=False, little_endian=True)
    return path


def write_rtstruct(path, rings, *, name="bone", place=identity, names=None, preamble=True, **more):
    """An RTSTRUCT of rings (M, 2) with their z; `place` carries points into the patient."""
    contours = []
    for corners, z in rings:
        points = place(np.c_[corners, np.full(len(corners), z)])
        texts = [f"{x:.7f}"[:16] for x in points.ravel()]
        contours.append(
            item(ContourGeometricType="CLOSED_PLANAR", NumberOfContourPoints=len(points),
                 ContourData=texts)
        )  # fmt: skip
    labels = list(enumerate(names or [name], start=1))
    return write_dicom(
        path, "1.2.840.10008.5.1.4.1.1.481.3", "1.2.826.99.7.1", "RTSTRUCT", preamble,
        StructureSetROISequence=[item(ROINumber=n, ROIName=label) for n, label in labels],
        ROIContourSequence=[
            item(ReferencedROINumber=n, ContourSequence=contours if n == 1 else [])
            for n, _ in labels
        ], **more,
    )  # fmt: skip


@dataclass(frozen=True)
class Grid:
    """Voxels: `corner` and the steps along i, j, k as columns of `axes` [mm], in LPS."""

    corner: np.ndarray
    axes: np.ndarray
    size: tuple[int, int, int]

    def labels(self, bone):
        """(I, J, K) uint8: 1 where a voxel's centre is inside."""
        index = np.stack(np.meshgrid(*map(np.arange, self.size), indexing="ij"), axis=-1)
        points = index.reshape(-1, 3) @ self.axes.T + self.corner
        return (bone.level(points) < 0).reshape(self.size).astype(np.uint8)


def grid_round(gap, pixel=0.5):
    """A grid of axial slices at the places of `BENT`."""
    corner = np.array([-30.13, -22.07, BENT.low])
    count = (round(64 / pixel), round(44 / pixel), len(BENT.places(gap)))
    return Grid(corner, np.diag([pixel, pixel, gap]), count)


def write_nrrd(path, labels, grid, space="left-posterior-superior"):
    import nrrd

    sign = np.array([1, 1, 1]) if space.startswith("left") else np.array([-1, -1, 1])
    header = {
        "space": space,
        "space directions": (grid.axes * sign[:, None]).T,
        "space origin": grid.corner * sign,
        "encoding": "gzip",
        "Segment0_ID": "s0",
        "Segment0_Name": "bone",
        "Segment0_LabelValue": "1",
        "Segment0_Layer": "0",
    }
    nrrd.write(str(path), labels, header)
    return path


def write_nifti(path, labels, grid):
    import nibabel

    affine = np.eye(4)
    affine[:3, :3], affine[:3, 3] = grid.axes, grid.corner
    image = nibabel.Nifti1Image(labels, np.diag([-1.0, -1, 1, 1]) @ affine)
    image.header.set_xyzt_units("mm")
    nibabel.save(image, str(path))
    return path


def write_seg(path, labels, grid, name="bone", kind="BINARY", **more):
    """A DICOM SEG with a frame a slice along k, packed by bits."""
    along, down = grid.axes[:, 0], grid.axes[:, 1]
    spacing = [float(np.linalg.norm(down)), float(np.linalg.norm(along))]
    direction = [float(x) for axis in (along, down) for x in axis / np.linalg.norm(axis)]
    places = grid.corner + np.arange(grid.size[2])[:, None] * grid.axes[:, 2]
    shared = item(
        PixelMeasuresSequence=[item(PixelSpacing=spacing)],
        PlaneOrientationSequence=[item(ImageOrientationPatient=direction)],
    )
    frames = [
        item(
            PlanePositionSequence=[item(ImagePositionPatient=place)],
            SegmentIdentificationSequence=[item(ReferencedSegmentNumber=1)],
        )
        for place in places.tolist()
    ]
    bits, raw = 1, labels.transpose(2, 1, 0)
    if kind == "BINARY":
        raw = np.packbits(raw.ravel() != 0, bitorder="little")
    else:
        bits, more = 8, {"MaximumFractionalValue": 255} | more
    raw = raw.tobytes()
    return write_dicom(
        path, "1.2.840.10008.5.1.4.1.1.66.4", "1.2.826.99.7.2", "SEG", SegmentationType=kind,
        SegmentSequence=[item(SegmentNumber=1, SegmentLabel=name)],
        SharedFunctionalGroupsSequence=[shared], PerFrameFunctionalGroupsSequence=frames,
        NumberOfFrames=grid.size[2], Rows=grid.size[1], Columns=grid.size[0],
        SamplesPerPixel=1, PhotometricInterpretation="MONOCHROME2", PixelRepresentation=0,
        BitsAllocated=bits, BitsStored=bits, HighBit=bits - 1,
        PixelData=raw + bytes(len(raw) % 2), **more,
    )  # fmt: skip


def write_curves(path, rings, *, ras=False, every=8):
    """Slicer's closed curves, one a ring, through every few of its corners."""
    sign = np.array([-1, -1, 1]) if ras else np.ones(3)
    markups = [
        {
            "type": "ClosedCurve",
            "coordinateSystem": "RAS" if ras else "LPS",
            "coordinateUnits": "mm",
            "controlPoints": [
                {"id": str(k), "position": (np.append(p, z) * sign).tolist()}
                for k, p in enumerate(corners[::every])
            ],
        }
        for corners, z in rings
    ]
    path.write_text(json.dumps({"@schema": SCHEMA, "markups": markups}))
    return path
