"""Read a planned slice as a `PlannedImage`: PNG, JPEG, TIFF, BMP or DICOM.

Pixels are counted u to the right and v down, and the *centre* of the top-left pixel is (0, 0).
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.display import MM
from vfplan.errors import ImageError, InputError, SettingError
from vfplan.findings import Finding, Findings, doubt, note
from vfplan.fixture import Fixture
from vfplan.geometry import PixelSpacing
from vfplan.geometry.lines import Array
from vfplan.images.dicom import is_dicom, memory_file, read_dicom
from vfplan.images.raster import (
    ALPHA,
    COLOURS,
    PREMULTIPLIED,
    READERS,
    ColourPixels,
    Header,
    Tag,
    check_size,
    chosen_index,
    decode_raster,
    read_header,
    upright,
)  # fmt: skip
from vfplan.io.files import OpenedFile, naming_place, opened_file, parse_decimal, read_whole
from vfplan.io.sandbox import run_in_sandbox, run_once
from vfplan.settings import MISFIT, incomplete_recipe, value_as

# Bytes of an image file. OpenCV's decoders take no more.
MAX_BYTES = 2**31 - 1
# Pixels that are read unless the caller says otherwise, in millions: 8000 x 8000, sixteen times a
# large CT slice. A file of a megabyte can decode to gigabytes; a slice that is planned on does not.
MAX_MEGAPIXELS = 64.0
# The most that a caller may allow, in millions: 16384 x 16384 of one page.
LARGEST_MEGAPIXELS = 268.5

# Where a bundle's recipe keeps how a photograph was made flat, as `made_flat` takes it.
MADE_FLAT_BY = "made_flat_by"

# So many times a flat picture may enlarge its photograph without a word. A camera that looks at the
# sheet from 60 degrees off its normal enlarges it twice, and more where the sheet is further away.
MAX_ENLARGEMENT = 3.0

# What is said of DICOM's overlay planes.
OVERLAY = (
    "The DICOM file has overlay planes, which are not read. If the curve is drawn there, save the "
    "slice as a colour picture with the overlay in it."
)
SQUARE = (
    "The DICOM file says that its pixels are not square (PixelAspectRatio), and their size says "
    "that they are. If they are not, give --pixel-spacing ALONG_U,ALONG_V."
)


@dataclass(frozen=True, eq=False)
class PlannedImage:
    """A slice with a surgeon's drawing on it.

    Parameters
    ----------
    rgb
        (H, W, 3) uint8 or uint16, red first.
    pixel_spacing_mm
        (along u, between columns; along v, between rows) [mm/px]; `None` when nobody knows.
    sha256
        Of the file's bytes, lower-case hex; of the pixels for an array that came from no file.
    T_patient_image
        (4, 3) mapping [u v 1] to the patient's LPS frame [m]; DICOM only, `None` when unknown.
    instance
        DICOM's SOP instance UID; empty for other files.
    orientation
        EXIF's, 1 to 8, by which the picture was turned; 1 where it was not.
    findings
        What was read otherwise than a person may expect.
    grey_range
        The values of black and white in a grey DICOM slice or volume, Hounsfield units in a CT.
    where
        The file that it was read from; empty for an array.
    """

    rgb: ColourPixels
    pixel_spacing_mm: PixelSpacing = None
    sha256: str = ""
    T_patient_image: Array | None = None
    instance: str = ""
    orientation: int = 1
    findings: Findings = ()
    grey_range: Sequence[float] | None = None
    where: str = ""

    @property
    def width_px(self) -> int:
        """Columns."""
        return self.rgb.shape[1]

    @property
    def height_px(self) -> int:
        """Rows."""
        return self.rgb.shape[0]


def as_image(image: PlannedImage | NDArray | str | Path) -> PlannedImage:
    """The image itself, an (H, W, 3) array of uint8 or uint16 wrapped as one, or a file, read.

    Raises `ImageError` for any other shape or type, and as `read_image` does.
    """
    if isinstance(image, PlannedImage):
        return image
    if isinstance(image, (str, Path)):
        return read_image(image)
    rgb = np.asarray(image)
    is_colour = rgb.ndim == 3 and rgb.shape[2] == 3 and rgb.size > 0
    if not is_colour or rgb.dtype not in (np.uint8, np.uint16):
        raise ImageError(
            f"the image array is {rgb.shape} of {rgb.dtype}. "
            "Give (H, W, 3) of uint8 or uint16, red first."
        )
    return PlannedImage(rgb, None, hashlib.sha256(np.ascontiguousarray(rgb)).hexdigest())


def is_picture_file(path: str | Path) -> bool:
    """Whether a file begins as a picture does; `False` where it cannot be read."""
    try:
        with opened_file(Path(path)) as file:
            start = file.read(io.DEFAULT_BUFFER_SIZE)
    except InputError:
        return False
    return is_dicom(start) or start.startswith(tuple(READERS))


def read_image(
    path: str | Path, *, frame: int | None = None,
    pixel_spacing_mm: PixelSpacing = None, imager_spacing: bool = False,
    max_megapixels: float = MAX_MEGAPIXELS, pixels: str | None = None,
) -> PlannedImage:  # fmt: skip
    """Read a planned slice.

    Parameters
    ----------
    path
        A PNG (8 or 16 bit, palette, alpha), JPEG, TIFF or BMP file, or DICOM. EXIF
        orientation is applied; transparent pixels are laid over black.
    frame
        Which frame of a multi-frame DICOM or page of a TIFF, from 1; needed when there are several.
    pixel_spacing_mm
        (along u, along v) [mm/px], when the caller knows; it wins over the file's own.
    imager_spacing
        Accept DICOM's ImagerPixelSpacing, which is measured at the detector, not in the patient.
    max_megapixels
        A larger picture is refused before it is decoded, in millions of pixels.
    pixels
        "as-stored" does not turn the picture as EXIF says, for pixels that were counted by a
        program that did not either; "as-shown" or `None` turns it.

    Raises
    ------
    ImageError
        The file is missing, not an image, damaged, or of a kind that is not supported.
    """
    where = str(path)
    if not 0 < max_megapixels <= LARGEST_MEGAPIXELS:
        raise SettingError(
            f"max_megapixels is {max_megapixels:g}. "
            f"Give a number above 0, and at most {LARGEST_MEGAPIXELS:g}.",
            code="out-of-range", numbers={"max_megapixels": max_megapixels},
        )  # fmt: skip
    max_pixels = int(1e6 * max_megapixels)
    data = read_whole(Path(path), MAX_BYTES, ImageError)
    if not data:
        raise ImageError("is empty. Give an image.", where=where)
    sha256 = hashlib.sha256(data).hexdigest()
    place, instance, orientation, findings, grey_range = None, "", 1, (), None
    if is_dicom(data):
        with naming_place(where):
            rgb, spacing_mm, place, instance, remarks, grey_range = read_dicom(
                data, where, frame, imager_spacing, max_pixels
            )
            size_mm = pixel_spacing_mm or spacing_mm
            if "pixel-aspect" in remarks and not size_mm:
                raise ImageError(
                    "has pixels that are not square (PixelAspectRatio), of no known size. Give "
                    "--pixel-spacing ALONG_U,ALONG_V.",
                    code="pixel-aspect",
                )
        if "overlay-left-out" in remarks:
            findings += (note("overlay-left-out", "extract", OVERLAY),)
        if "pixel-aspect" in remarks and size_mm[0] == size_mm[1]:
            findings += (doubt("pixels-square", "extract", SQUARE),)
    elif is_volume(data):
        _, place, grey_range, grey = volume_slice(data, where, frame)
        check_size(grey.shape[1], grey.shape[0], max_pixels)
        spacing_mm = tuple((1e3 * np.linalg.norm(place[:3, :2], axis=0)).tolist())
        rgb = np.repeat(grey[..., None], 3, axis=2)
    else:
        with naming_place(where):
            header = read_header(data, max_pixels)
            index = chosen_index("page", frame, len(header.tags))
            rgb = decode_raster(data, header, index)
            orientation = 1 if pixels == "as-stored" else header.orientation(index)
            findings = [*raster_findings(header, index, len(data), orientation)]
        told, spacing_mm = header.made_flat.split(), None
        if len(told) == 3:
            spacing_mm = (float(told[2]), float(told[2]))
        used_bits = int(rgb.max()).bit_length()
        if rgb.dtype == np.uint16 and 0 < used_bits < 16:
            rgb = rgb << (16 - used_bits)
            text = f"The picture uses {used_bits} of its 16 bits, and was stretched to all."
            findings.append(note("range-stretched", "extract", text))
        rgb = upright(rgb, orientation)
    return PlannedImage(
        rgb, pixel_spacing_mm or spacing_mm, sha256, place, instance, orientation,
        tuple(findings), grey_range, where,
    )  # fmt: skip


def is_volume(data: bytes) -> bool:
    """Whether the bytes begin as an NRRD or NIfTI file does, the latter also packed by gzip."""
    return (
        data.startswith((b"NRRD", b"\x1f\x8b")) or data[344:347] == b"n+1" or (data[4:7] == b"n+2")
    )


def volume_slice(
    data: bytes, where: str, number: int | None
) -> tuple[int, Array, list[float], NDArray[np.uint16] | None]:
    """How many slices a volume has, where one lies (4, 3), its range, its greys; of 0 no greys."""
    with memory_file(data) as file:
        # The surfaces' reader runs in a process of its own.
        job = "vfplan.surface.volumes:grey_slice"
        try:
            (count, place, grey_range), *grey = run_in_sandbox(job, number, file=file, where=where)
        except InputError as error:
            raise ImageError(error.message, where=where, code=error.code) from None
    return count, np.array(place), grey_range, grey[0][0] if grey else None


# Setting of a recipe: the points that a person set in Slicer, on the slice [px], for the sheet.
SLICER_POINTS = "slicer_points_px"

# Setting of a recipe: which slice of a stack it was, for a reader.
SLICE_IN_WORDS = "slice_in_words"


@dataclass(frozen=True)
class StackedSlice:
    """A slice of a stack: its file, its frame from 1 if there are several, and its series."""

    path: Path
    frame: int | None
    series: str


def read_stack(path: Path) -> tuple[StackedSlice, ...]:
    """The slices of a volume, of a DICOM file or of all in a folder.

    They are sorted by series, then along the patient.

    One that does not say where it lies follows those that do, in the order of the files. Raises as
    `read_dicom` for a file that cannot be read, and `ImageError` where a folder holds none.
    """
    rows = []
    for file in sorted(path.iterdir()) if path.is_dir() else [path]:
        if not file.is_file():
            continue
        opened, where = OpenedFile(file, ImageError), str(file)
        start = opened.view().read(352)
        if is_volume(start) and file == path:
            count = volume_slice(read_whole(path, MAX_BYTES, ImageError), where, 0)[0]
            return tuple(StackedSlice(path, number, "volume") for number in range(1, count + 1))
        if not is_dicom(start):
            continue
        job = "vfplan.images.dicom:describe"
        series, title, heights = run_once(job, file=opened, where=where, kind=ImageError)
        for number, height in enumerate(heights, start=1):
            frame = number if len(heights) > 1 else None
            order = (title, series, height is None, height or 0.0, len(rows))
            rows.append((order, StackedSlice(file, frame, title)))
    if not rows and path.is_dir():
        text = "holds no DICOM slice. Give the folder of a series"
        raise ImageError(text, where=path, code="no-slices")
    return tuple(slice_ for _, slice_ in sorted(rows, key=itemgetter(0)))


def raster_findings(header: Header, index: int, size: int, orientation: int) -> Iterator[Finding]:
    """What a picture's header says that a person may not expect."""
    if orientation != 1:
        text = f"The picture is turned by its EXIF tag (orientation {orientation})."
        yield note("picture-turned", "extract", text)
    if header.made_flat:
        yield from flat_findings(header.made_flat.decode("latin-1"))
    if header.end < size:
        text = f"{size - header.end} bytes follow the end of the picture, and were not read."
        yield note("data-behind-end", "extract", text)
    tags = header.tags[index]
    has_extra = tags.get(Tag.SAMPLES, 1) > COLOURS.get(tags.get(Tag.PHOTOMETRIC, 0), 1)
    if has_extra and tags.get(Tag.EXTRA) not in (PREMULTIPLIED, ALPHA):
        text = (
            "The TIFF has a sample beside its colours and does not say what it means. The colours "
            "were taken as they are. Compare them with the picture, or export it as RGB."
        )
        yield doubt("extra-sample", "extract", text)


def read_slice_of(fixture: Fixture, path: str | Path) -> PlannedImage:
    """The slice of a bundle, read as it was when its curve was taken; raises as `read_image`."""
    chosen = fixture.provenance.settings
    image = read_image(path, frame=chosen.get("frame"), pixels=chosen.get("pixels"))
    return flat_as_planned(image, chosen)


def plane_of_slice(fixture: Fixture, image: PlannedImage | None) -> Array | None:
    """(3, 3) from (u, v, 1) of the slice to the frame of the fixture [m]; `None` if unknown."""
    record = fixture.registration
    if record is not None and record.source_frame == "image":
        return record.T_robot_image
    if image is None or image.T_patient_image is None:
        return None
    plane = image.T_patient_image[:3]
    if record is not None:
        plane = record.T_robot_image[:3, :3] @ plane
        plane[:, 2] += record.T_robot_image[:3, 3]
    return plane


def height_in_words(image: PlannedImage) -> str:
    """Where a slice lies along the patient."""
    middle = [image.width_px / 2 - 0.5, image.height_px / 2 - 0.5, 1]
    return f"its middle at patient z = {MM * (image.T_patient_image @ middle)[2]:z.2f} mm"


# Share of a direction from which on its side is named too: less is nearer to the main one.
OBLIQUE = np.sin(np.pi / 8)


def side_of_patient(direction: Array) -> str:
    """The letters of a direction in LPS, the main one first: L R, P A, H F; a second if oblique."""
    share = np.abs(direction) / np.linalg.norm(direction)
    axes = [axis for axis in np.argsort(-share, kind="stable")[:2] if share[axis] > OBLIQUE]
    return "".join(("LPH" if direction[axis] > 0 else "RAF")[axis] for axis in axes)


def slice_file(fixture: Fixture, path: Path) -> Path:
    """The file of a bundle's slice, which a folder is searched for by its SHA-256."""
    if not path.is_dir():
        return path
    wanted = fixture.provenance.inputs.get("image")
    for file in sorted(path.iterdir()):
        if file.is_file() and OpenedFile(file, ImageError).sha256() == wanted:
            return file
    named = fixture.provenance.settings.get(SLICE_IN_WORDS, f"SHA-256 {str(wanted)[:12]}...")
    text = f"holds no file that is the bundle's slice ({named}). Give the folder that holds it"
    raise ImageError(text, where=path, code="another-slice")


def flat_as_planned(image: PlannedImage, recipe: dict[str, Any]) -> PlannedImage:
    """The picture as a bundle's recipe has it: made flat, where it was planned on so."""
    numbers = value_as(tuple[float, ...], recipe.get(MADE_FLAT_BY, ""))
    if numbers is MISFIT or len(numbers) not in (0, 12):
        raise incomplete_recipe(f"{MADE_FLAT_BY} is {recipe[MADE_FLAT_BY]!r}")
    return made_flat(image, numbers) if numbers else image


def made_flat(image: PlannedImage, numbers: Sequence[float]) -> PlannedImage:
    """The flat picture of a photograph.

    numbers: the homography from its pixels to those of the flat picture, by rows; width and height
        of that [px], and the size of its pixels [mm]
    """
    import cv2

    homography, (width, height, spacing_mm) = np.reshape(numbers[:9], (3, 3)), numbers[9:]
    rgb = cv2.warpPerspective(image.rgb, homography, (int(width), int(height)))
    return replace(image, rgb=rgb, pixel_spacing_mm=(spacing_mm, spacing_mm), T_patient_image=None)


def flat_findings(text: str) -> Iterator[Finding]:
    """What a person should know of a plan on a picture that was made flat.

    text: RMS residual of the markers [mm], and how much larger than a pixel of the photograph a
        pixel of the flat picture is shown at most; then the flat picture's pixel spacing [mm]
    Raises ImageError: the text does not begin with two numbers
    """
    try:
        residual_mm, enlargement, *_ = map(parse_decimal, text.split())
    except ValueError:
        message = f"says that it was made flat by {text[:40]!r}. Make it flat again: vfplan rectify"
        raise ImageError(message, code="made-flat-invalid") from None
    yield doubt(
        "picture-made-flat", "extract",
        f"The photograph was made flat by its markers, which fit to {residual_mm:.2f} mm rms. The "
        "error bound does not count this step. Compare the flat picture with the sheet.",
    )  # fmt: skip
    if enlargement > MAX_ENLARGEMENT:
        yield doubt(
            "picture-enlarged", "extract",
            f"So strong is the photograph's angle that a part is {enlargement:.1f} times enlarged "
            "and blurred. Take it from further above.",
        )  # fmt: skip


def as_uint8(rgb: NDArray) -> NDArray[np.uint8]:
    """The slice in 8 bits: as it is, or of 16 bits so that its brightest value is white."""
    if rgb.dtype == np.uint8:
        return rgb
    return np.rint(rgb * (255.0 / max(1, int(rgb.max())))).astype(np.uint8)
