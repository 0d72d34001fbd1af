"""The camera, where it stands before the tags, and how far off a drawn line may be.

The pose follows from all corners at once by least squares. Its covariance follows from what the
corners leave over, and is carried to the line along the sheet.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vfplan.camera.sheet import BOARD, DICTIONARY, Array, TagCorners
from vfplan.errors import CheckFailed, InputError
from vfplan.io.files import read_text

Picture = NDArray[np.uint8]

# Bytes of a calibration at most; one has a few hundred.
MAX_CALIBRATION_BYTES = 1 << 20

# How many coefficients OpenCV takes of a lens.
COEFFICIENTS = (0, 4, 5, 8, 12, 14)

# The fields of a calibration file: the shapes of their numbers, and which are allowed.
FIELDS = {
    "image_width": ((), "a whole number above 0"),
    "image_height": ((), "a whole number above 0"),
    "camera_matrix": ((3, 3), "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with fx and fy above 0"),
    "distortion_coefficients": ((-1,), "0, 4, 5, 8, 12 or 14 finite numbers"),
}

# Fewest tags of a pose: two of another sheet agree by chance once in a million.
MIN_TAGS = 2

# Share by which a print may be longer one way than the other, or slanted. A printer keeps to 0.2 %,
# and a page that was stretched onto another paper is off by 3 %. Of 0.5 % a line moves by 0.2 mm.
MAX_STRETCH = 0.004

# Standard deviations by which a stretch must exceed 0 before it is called one.
CERTAIN = 5.0

# Side of the window [px] whose mean tells black from white. OpenCV's own three windows find the
# same tags in twice the time.
WINDOW_PX = 23

# Shortest way around a tag as a share of the picture's width: 90 px of 1280.
MIN_PERIMETER = 0.07

# Steps of Newton from OpenCV's pose on; the second changes nothing any more.
STEPS = 2

# Corners that a picture of the board shows at least, of 54: enough to tell its tilt.
MIN_CORNERS = 12

# Such pictures of a calibration at least: two tilts to each side.
MIN_PICTURES = 8

# Standard deviation of the focal length at most, as a share of it: over 5 cm of height above the
# tags it turns into 0.1 mm.
MAX_FOCAL_SIGMA = 0.002


@dataclass(frozen=True, eq=False)
class Camera:
    """A calibrated camera, with the names that ROS gives; coefficients in OpenCV's order."""

    image_width: int
    image_height: int
    camera_matrix: Array
    distortion_coefficients: Array

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of its pictures [px]."""
        return self.image_width, self.image_height

    def project(self, places: Array, pose: Array) -> tuple[Array, Array]:
        """(N, 2) pixels of places, and (N, 2, 6) how they follow from `pose`, (6,)."""
        lens = self.camera_matrix, self.distortion_coefficients
        places = np.ascontiguousarray(places)
        pixels, jacobian = cv2.projectPoints(places, pose[:3], pose[3:], *lens)
        return pixels[:, 0], jacobian[:, :6].reshape(-1, 2, 6)


def read_camera(path: Path | None) -> Camera:
    """The camera of a calibration file; raises `InputError` where there is none."""
    if path is None:
        how = "vfplan ar --board-out BOARD.pdf, then vfplan ar --calibrate PICTURES -o CALIB.json"
        message = f"A camera without a calibration shows no wall. Make one: {how}"
        raise InputError(message, code="camera-uncalibrated")
    lens, problem = [], "it is no JSON file"
    try:
        data = json.loads(read_text(path, MAX_CALIBRATION_BYTES, InputError)[0])
        for name, (shape, allowed) in FIELDS.items():
            problem = f"{name} is missing"
            # ROS puts each matrix into a table of its own, under `data`.
            numbers = data[name]["data"] if isinstance(data[name], dict) else data[name]
            problem = f"{name} is {str(numbers)[:250]}, not {allowed}"
            lens.append(np.array(numbers, float).reshape(shape))
            if not np.isfinite(lens[-1]).all() or not is_allowed(lens[-1]):
                raise ValueError(problem)
    except (KeyError, TypeError, ValueError, OverflowError, RecursionError):
        message = (
            f"is no calibration: {problem}. vfplan ar --calibrate writes one; of another program's "
            "write a JSON file with image_width, image_height, camera_matrix and "
            "distortion_coefficients"
        )
        raise InputError(message, where=path, code="calibration-file") from None
    width, height, matrix, distortion = lens
    return Camera(int(width), int(height), matrix, distortion)


def is_allowed(numbers: Array) -> bool:
    """Whether finite numbers of a calibration are as `FIELDS` says: a size, a matrix or a lens."""
    if numbers.ndim == 0:
        return numbers > 0 and numbers % 1 == 0
    if numbers.ndim == 1:
        return len(numbers) in COEFFICIENTS
    (fx, _, u), (_, fy, v), _ = numbers
    return min(fx, fy) > 0 and np.array_equal(numbers, [[fx, 0, u], [0, fy, v], [0, 0, 1]])


@dataclass(frozen=True, eq=False)
class Pose:
    """Where the camera stands before the sheet.

    Parameters
    ----------
    vector
        (6,) rotation vector and translation [m] into the camera's frame: x to the right, y down, z
        into the picture.
    residuals
        (2 N,) what the corners leave over [px].
    covariance
        (6, 6) of the vector.
    """

    camera: Camera
    vector: Array
    residuals: Array
    covariance: Array

    @property
    def T_camera_sheet(self) -> Array:
        """(4, 4) from the sheet to the camera [m]."""
        return transform(self.vector)

    def project(self, places: Array) -> Array:
        """(N, 2) pixels of places on the sheet (N, 3)."""
        return self.camera.project(places, self.vector)[0]

    def bound_m(self, places: Array) -> Array:
        """(N,) how far off each place is on the sheet at most, with 0.95 [m]."""
        jacobian = self.camera.project(places, self.vector)[1]
        rows = np.linalg.solve(along_sheet(jacobian, self.vector)[:, :, :2], jacobian)
        longest = np.linalg.eigvalsh(rows @ self.covariance @ rows.transpose(0, 2, 1))[:, -1]
        # The longer half axis of the ellipse. F of 2 and `dof` degrees has a closed form.
        dof = len(self.residuals) - 7
        return np.sqrt(dof * (0.05 ** (-2 / dof) - 1) * longest)


def transform(vector: Array) -> Array:
    """(4, 4) of a rotation vector and a translation."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = cv2.Rodrigues(vector[:3])[0], vector[3:]
    return T


def along_sheet(jacobian: Array, vector: Array) -> Array:
    """(N, 2, 3) pixels a metre of the sheet: a place moves a pixel as the translation does."""
    return jacobian[:, :, 3:] @ transform(vector)[:3, :3]


def make_finder() -> Any:
    """OpenCV's detector of the tags."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    parameters.adaptiveThreshWinSizeMin = parameters.adaptiveThreshWinSizeMax = WINDOW_PX
    parameters.minMarkerPerimeterRate = MIN_PERIMETER
    return cv2.aruco.ArucoDetector(DICTIONARY, parameters)


def find_tags(finder: Any, grey: Picture) -> TagCorners:
    """Number -> (4, 2) corners [px] of the tags in a grey picture."""
    corners, numbers, _ = finder.detectMarkers(grey)
    numbers = [] if numbers is None else numbers.ravel().tolist()
    return {n: quad[0].astype(float) for n, quad in zip(numbers, corners, strict=True)}


def locate(found: TagCorners, tags: TagCorners, camera: Camera, *, is_printed: bool = True) -> Pose:
    """The pose by the tags that were found.

    Raises
    ------
    CheckFailed
        Fewer than two of the tags are seen, or another sheet, or the print is stretched.
    """
    seen, others = found.keys() & tags.keys(), found.keys() - tags.keys()
    if others and is_printed:
        text = f"Tag {min(others)} is not of this plan. Print its sheet: vfplan review --print-out"
        raise CheckFailed(text, code="other-sheet")
    if len(seen) < MIN_TAGS:
        text = f"{len(seen)} tags of this plan are seen. Show {MIN_TAGS} or more"
        raise CheckFailed(text, code="one-tag" if seen else "no-tag")
    corners = np.stack([tags[number] for number in seen])
    outward = (corners - corners.mean(axis=1, keepdims=True)).reshape(-1, 3)
    places, pixels = corners.reshape(-1, 3), np.concatenate([found[number] for number in seen])
    _, *start = cv2.solvePnP(places, pixels, camera.camera_matrix, camera.distortion_coefficients)
    vector, growth = np.ravel(start), 0.0
    for _ in range(STEPS):
        projected, jacobian = camera.project(places + growth * outward, vector)
        along = along_sheet(jacobian, vector)
        # Ink, blur and light let the black of all tags grow or shrink alike.
        rows = np.dstack([jacobian, along @ outward[:, :, None]]).reshape(-1, 7)
        left = (pixels - projected).ravel()
        step = np.linalg.lstsq(rows, left)[0]
        vector, growth = vector + step[:6], growth + step[6]
    left -= rows @ step
    covariance = left @ left / (len(left) - 7) * np.linalg.inv(rows.T @ rows)[:6, :6]

    # Longer along y, and slanted: what no pose can mimic.
    x, y = places[:, :2].T[:, :, None]
    shapes = np.dstack([along[:, :, 1] * y, along[:, :, 0] * y + along[:, :, 1] * x])
    inverse = np.linalg.pinv(np.hstack([rows, shapes.reshape(-1, 2)]))
    sigma = np.sqrt(left @ left / len(left) * np.square(inverse[7:]).sum(axis=1))
    stretch = np.abs(inverse[7:] @ left)
    if (stretch > np.maximum(MAX_STRETCH, CERTAIN * sigma)).any():
        longer = f"{100 * stretch.max():.1f} % longer one way than the other"
        text = f"The print is {longer}. Print it at 100 %, not fitted to the page"
        raise CheckFailed(text, code="print-stretched")
    return Pose(camera, vector, left, covariance)


def calibrate(pictures: Iterable[Picture]) -> tuple[Camera, float, int]:
    """A camera by grey pictures of the board; what it leaves over [px], and how many showed it.

    Raises
    ------
    InputError
        The pictures differ in size, or too few show the board from sides that tell.
    """
    finder = cv2.aruco.CharucoDetector(BOARD)
    views, sizes, focal_sigma = [], set(), np.inf
    for picture in pictures:
        sizes.add(picture.shape[::-1])
        corners, numbers, *_ = finder.detectBoard(picture)
        if numbers is not None and len(numbers) >= MIN_CORNERS:
            views.append(BOARD.matchImagePoints(corners, numbers))
    if len(views) >= MIN_PICTURES and len(sizes) == 1:
        seen = *zip(*views, strict=True), *sizes
        rms_px, matrix, distortion, *_, sigma, _, _ = cv2.calibrateCameraExtended(*seen, None, None)
        focal_sigma = sigma[:2].max() / matrix[0, 0]
    if focal_sigma > MAX_FOCAL_SIGMA:
        raise InputError(
            f"{len(views)} pictures show the board, in sizes {sorted(sizes)}, and leave the focal "
            f"length open by {100 * focal_sigma:.2f} %. Give {MIN_PICTURES} or more of one size, "
            "with the board tilted by 30 degrees to all sides and also near the edges",
            code="calibration-weak",
        )
    return Camera(*seen[2], matrix, distortion.ravel()), rms_px, len(views)
