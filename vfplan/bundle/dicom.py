"""Strokes as a DICOM RTSTRUCT and a closed mesh as a DICOM SEG, in a patient's study.

DICOM PS3.3 A.19 (RT Structure Set) and A.51 (Segmentation). A bundle knows no patient: who it is,
and the grid of the SEG, come from a slice of the study.
"""

from __future__ import annotations

import hashlib
import io
from pathlib import Path
from typing import Any

import numpy as np

from vfplan.bundle.leak import Rows, open_edges
from vfplan.errors import InputError, SettingError
from vfplan.fixture import Fixture
from vfplan.geometry.lines import Array, Flags
from vfplan.images.dicom import open_dataset, pixel_axes, refuse_costly
from vfplan.io.files import FilePath, naming_place, now_utc, read_bytes

RTSTRUCT = "1.2.840.10008.5.1.4.1.1.481.3"
SEG = "1.2.840.10008.5.1.4.1.1.66.4"
# What is the same in all objects of a study.
OF_STUDY = (
    *("PatientName", "PatientID", "PatientBirthDate", "PatientSex", "StudyInstanceUID"),
    *("StudyDate", "StudyTime", "StudyID", "AccessionNumber", "ReferringPhysicianName"),
)
# Most voxels of a segment.
MAX_VOXELS = 1 << 30


def in_patient(fixture: Fixture, points: Array) -> tuple[Array, str]:
    """Points in the patient's frame where the registration tells it, and their frame's name."""
    record = fixture.registration
    if record is None or record.source_frame != "patient_lps":
        return points, fixture.frame
    T_patient_robot = np.linalg.inv(record.T_robot_image)
    return points @ T_patient_robot[:3, :3].T + T_patient_robot[:3, 3], "patient_lps"


def study_slice(study: FilePath | None) -> tuple[Any, str]:
    """The header of a slice of a study, without its pixels, and the SHA-256 of its file.

    Raises SettingError: none was given
    Raises InputError: it names no study, no frame of reference, or not how it lies
    """
    if study is None:
        text = "A .dcm belongs to a patient's study. Give a slice of it: --study SLICE.dcm"
        raise SettingError(text, code="study-missing")
    data, digest = read_bytes(Path(study))
    with naming_place(study):
        refuse_costly(data)
        with open_dataset(io.BytesIO(data), InputError) as dataset:
            for keyword in ("StudyInstanceUID", "FrameOfReferenceUID", "ImagePositionPatient"):
                if not dataset.get(keyword):
                    text = f"has no {keyword}. Give a slice of the study that was planned on"
                    raise InputError(text, code="study-incomplete")
            dataset.pop("PixelData", None)
            return dataset, digest


def slice_axes(source: Any) -> tuple[Array, Array]:
    """(3, 2) steps along a row and along a column of a slice, and its first pixel [m]."""
    row_mm, column_mm = map(float, source.get("PixelSpacing") or (0, 0))
    axes = pixel_axes(source.get("ImageOrientationPatient"), (column_mm, row_mm))
    if axes is None:
        text = "The slice of the study does not say how it lies. Give another with --study."
        raise InputError(text, code="study-incomplete")
    return axes, 1e-3 * np.array(source.ImagePositionPatient, float)


def points_in_study(fixture: Fixture, points: Array, source: Any, digest: str) -> Array:
    """Points in the patient's frame, by the registration or the slice that was planned on [m].

    Raises InputError: nothing ties them to the patient
    """
    places, frame = in_patient(fixture, points)
    record = fixture.registration
    if frame == "patient_lps":
        return places
    if record is None or fixture.provenance.inputs.get("image") != digest:
        raise InputError(
            f"Its points are of the frame {frame}, and nothing says where that is in this study. "
            "Give as --study the very slice that was planned on, or write it as .ply.",
            code="frame-not-patient",
        )  # fmt: skip
    T = record.T_robot_image
    pixels, *_ = np.linalg.lstsq(T[:, :2], (points - T[:, 2]).T, rcond=None)
    axes, origin = slice_axes(source)
    return pixels.T @ axes.T + origin


def item(**values: Any) -> Any:
    """A data set of these elements."""
    from pydicom import Dataset

    made = Dataset()
    for keyword, value in values.items():
        setattr(made, keyword, value)
    return made


def written(made: Any, source: Any, kind: str, fixture: Fixture) -> bytes:
    """A data set as a file of a kind, in the study of a source."""
    from pydicom import FileMetaDataset, dcmwrite
    from pydicom.uid import ExplicitVRLittleEndian, generate_uid

    for keyword in OF_STUDY:
        setattr(made, keyword, source.get(keyword, ""))
    # The same fixture in the same study has the same names again.
    made.FrameOfReferenceUID, made.PositionReferenceIndicator = source.FrameOfReferenceUID, ""
    digest = hashlib.sha256(fixture.points.tobytes() + str(source.StudyInstanceUID).encode())
    names = [kind, digest.hexdigest()]
    made.SOPClassUID, made.SOPInstanceUID = kind, generate_uid(entropy_srcs=names)
    made.SeriesInstanceUID = generate_uid(entropy_srcs=[*names, "series"])
    made.SeriesNumber, made.InstanceNumber = 9001, 1
    made.Manufacturer, made.ManufacturerModelName = "vfplan", "vfplan"
    made.SoftwareVersions, made.DeviceSerialNumber = fixture.provenance.software, "0"
    made.SeriesDescription = "Virtual fixture"
    made.file_meta = FileMetaDataset()
    made.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
    file = io.BytesIO()
    dcmwrite(file, made, enforce_file_format=True)
    return file.getvalue()


def rtstruct(fixture: Fixture, study: FilePath | None) -> bytes:
    """The strokes as contours of one structure."""
    if fixture.curve is None:
        raise InputError("It has no strokes, which a .rtstruct.dcm would hold.")
    source, digest = study_slice(study)
    image = item(
        ReferencedSOPClassUID=source.SOPClassUID, ReferencedSOPInstanceUID=source.SOPInstanceUID
    )
    series = item(SeriesInstanceUID=source.SeriesInstanceUID, ContourImageSequence=[image])
    # The study itself, as PS3.3 C.8.8.5 names it.
    of_study = item(
        ReferencedSOPClassUID="1.2.840.10008.3.1.2.3.1",
        ReferencedSOPInstanceUID=source.StudyInstanceUID,
        RTReferencedSeriesSequence=[series],
    )
    uid = source.FrameOfReferenceUID
    contours = []
    for stroke in fixture.strokes:
        points = points_in_study(fixture, stroke.points, source, digest)
        texts = [f"{coordinate:.6f}" for coordinate in (1e3 * points).ravel()]
        spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        kind = "OPEN_PLANAR" if spread[2:].sum() < 1e-6 * spread[0] else "OPEN_NONPLANAR"
        contours.append(
            item(
                ContourGeometricType="CLOSED_PLANAR" if stroke.closed else kind,
                NumberOfContourPoints=len(points), ContourData=texts,
            )
        )  # fmt: skip
    made = item(
        Modality="RTSTRUCT", StructureSetLabel="vfplan", OperatorsName="",
        StructureSetDate=now_utc()[:10].replace("-", ""), StructureSetTime="000000",
        ReferencedFrameOfReferenceSequence=[
            item(FrameOfReferenceUID=uid, RTReferencedStudySequence=[of_study])
        ],
        StructureSetROISequence=[
            item(ROINumber=1, ReferencedFrameOfReferenceUID=uid, ROIName="virtual fixture",
                 ROIGenerationAlgorithm="SEMIAUTOMATIC")
        ],
        ROIContourSequence=[item(ReferencedROINumber=1, ContourSequence=contours)],
        RTROIObservationsSequence=[
            item(ObservationNumber=1, ReferencedROINumber=1, RTROIInterpretedType="",
                 ROIInterpreter="")
        ],
    )  # fmt: skip
    return written(made, source, RTSTRUCT, fixture)


def segmentation(fixture: Fixture, study: FilePath | None) -> bytes:
    """The inside of a closed mesh, on the grid of a slice."""
    from pydicom.datadict import tag_for_keyword
    from pydicom.pixels import pack_bits
    from pydicom.uid import generate_uid

    if fixture.mesh is None or open_edges(fixture.mesh):
        raise InputError("It has no closed mesh, whose inside a .seg.dcm would hold.")
    source, digest = study_slice(study)
    points = points_in_study(fixture, fixture.points, source, digest)
    axes, origin = slice_axes(source)
    row_mm, column_mm = map(float, source.PixelSpacing)
    step = float(source.get("SpacingBetweenSlices") or source.get("SliceThickness") or row_mm)
    normal = np.cross(axes[:, 0], axes[:, 1])
    axes = np.column_stack((axes, 1e-3 * step * normal / np.linalg.norm(normal)))
    places = np.linalg.solve(axes, (points - origin).T).T
    low = np.floor(places.min(axis=0)).astype(int)
    columns, rows, slices = (np.ceil(places.max(axis=0)).astype(int) - low + 1).tolist()
    # Some readers lose count of frames that end within a byte.
    columns += -columns % 8
    if columns * rows * slices > MAX_VOXELS:
        raise InputError("It takes too many voxels. Give a coarser slice.", code="too-many-voxels")
    # The frames are in the order of their places, as PS3.3 C.7.6.17 says it.
    frames, per_frame = [], []
    for k in range(slices):
        mask = section(places - low, fixture.mesh, k, (rows, columns))
        if not mask.any():
            continue
        frames.append(mask)
        place = 1e3 * (origin + axes @ (low + np.array([0, 0, k])))
        position = item(ImagePositionPatient=[f"{x:.6f}" for x in place])
        content = item(DimensionIndexValues=[len(frames)])
        per_frame.append(item(PlanePositionSequence=[position], FrameContentSequence=[content]))
    if not frames:
        raise InputError("It lies between two slices. Write it as .stl.", code="between-slices")
    code = item(CodeValue="85756007", CodingSchemeDesignator="SCT", CodeMeaning="Tissue")
    segment = item(
        SegmentNumber=1, SegmentLabel="virtual fixture", SegmentAlgorithmType="SEMIAUTOMATIC",
        SegmentAlgorithmName="vfplan", SegmentedPropertyCategoryCodeSequence=[code],
        SegmentedPropertyTypeCodeSequence=[code],
    )  # fmt: skip
    pixel = item(PixelSpacing=[row_mm, column_mm], SliceThickness=step, SpacingBetweenSlices=step)
    shared = item(
        PlaneOrientationSequence=[item(ImageOrientationPatient=source.ImageOrientationPatient)],
        PixelMeasuresSequence=[pixel],
        SegmentIdentificationSequence=[item(ReferencedSegmentNumber=1)],
    )
    organization = item(DimensionOrganizationUID=generate_uid(entropy_srcs=["vfplan", "place"]))
    dimension = item(
        DimensionOrganizationUID=organization.DimensionOrganizationUID,
        DimensionIndexPointer=tag_for_keyword("ImagePositionPatient"),
        FunctionalGroupPointer=tag_for_keyword("PlanePositionSequence"),
    )
    made = item(
        Modality="SEG", ImageType=["DERIVED", "PRIMARY"], SegmentationType="BINARY",
        SamplesPerPixel=1, PhotometricInterpretation="MONOCHROME2", Rows=rows, Columns=columns,
        BitsAllocated=1, BitsStored=1, HighBit=0, PixelRepresentation=0,
        NumberOfFrames=len(frames), LossyImageCompression="00", ContentLabel="VFPLAN",
        ContentDescription="", ContentCreatorName="", SegmentSequence=[segment],
        DimensionOrganizationSequence=[organization], DimensionIndexSequence=[dimension],
        SharedFunctionalGroupsSequence=[shared], PerFrameFunctionalGroupsSequence=per_frame,
        ContentDate=now_utc()[:10].replace("-", ""), ContentTime="000000",
        PixelData=pack_bits(np.array(frames, np.uint8)),
    )  # fmt: skip
    return written(made, source, SEG, fixture)


def section(places: Array, triangles: Rows, height: float, shape: tuple[int, int]) -> Flags:
    """(rows, columns) whether each pixel's centre of a plane lies within a closed mesh."""
    # Corners are never quite on a plane or a row: those at it count as above.
    outline = crossings(places[triangles], 2, height)
    mask = np.zeros((shape[0], shape[1] + 1), np.int64)
    for row in range(shape[0]):
        # A segment is cut on its way to its end and on the way back, at one place.
        at = crossings(outline, 1, row)[:, 0, 0]
        np.add.at(mask[row], np.clip(np.ceil(at).astype(int), 0, shape[1]), 1)
    return np.cumsum(mask, axis=1)[:, :-1] % 2 == 1


def crossings(corners: Array, axis: int, value: float) -> Array:
    """(n, 2, 3) where the sides of triangles or segments cross a plane, two places of each.

    corners: (K, 3, 3) or (K, 2, 3)
    """
    after = np.roll(corners, -1, axis=1)
    is_cut = (corners[..., axis] < value) != (after[..., axis] < value)
    start, end = corners[is_cut], after[is_cut]
    share = (value - start[:, axis]) / (end[:, axis] - start[:, axis])
    return (start + share[:, None] * (end - start)).reshape(-1, 2, 3)
