"""The camera, where it stands before the tags, and how far off a drawn line may be.

The pose follows from all corners at once by least squares. Its covariance follows from what the
corners leave over, and is carried to the line along the plan's plane.
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

from vfplan.camera.sheet import DICTIONARY, Target, board
from vfplan.errors import CheckFailed, InputError
from vfplan.io.files import read_text

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

# Bytes of a calibration at most; one has a few hundred.
MAX_CALIBRATION_BYTES = 1 << 20

# Fewest tags of a pose: two of another sheet agree by chance once in a million.
MIN_TAGS = 2

# Share by which a print may be longer one way than the other: a printer keeps to 0.2 %, and a page
# that was fitted to another paper is off by 3 %.
MAX_STRETCH = 0.01

# Standard deviations by which it must be certain.
CERTAIN = 5.0

# Side of the window [px] whose mean tells black from white, and the shortest way around a tag as a
# share of the picture's width, 90 px of 1280: with OpenCV's own, three windows and half of that,
# the same tags are found in twice the time.
WINDOW_PX, MIN_PERIMETER = 23, 0.07

# How far beside the picture a line is still carried, in halves of the picture; further out the
# distortion says nothing.
BESIDE = 1.3

# Steps of Newton from the first pose on; the third changes nothing any more.
ITERATIONS = 4

# Corners that a picture of the board shows at least, and such pictures of a calibration at least
# and at most.
MIN_CORNERS, MIN_PICTURES, MAX_PICTURES = 12, 8, 60

# Standard deviation of the focal length at most, as a share of it: over 5 cm of height above the
# tags it turns into 0.1 mm.
MAX_FOCAL_SIGMA = 0.002


@dataclass(frozen=True, eq=False)
class Camera:
    """A calibrated camera.

    Parameters
    ----------
    size_px
        Width and height of its pictures.
    matrix
        (3, 3) from the camera's frame to pixels.
    distortion
        (4, 5, 8, 12 or 14) coefficients in OpenCV's order.
    rms_px
        What the calibration left over; `None` where nobody says.
    """

    size_px: tuple[int, int]
    matrix: Array
    distortion: Array
    rms_px: float | None = None

    def project(self, places: Array, T_camera_target: Array) -> tuple[Array, Array]:
        """(N, 2) pixels of places, and (N, 2, 6) how they follow from rotation and translation."""
        turn = cv2.Rodrigues(T_camera_target[:3, :3])[0]
        pixels, jacobian = cv2.projectPoints(
            np.ascontiguousarray(places), turn, T_camera_target[:3, 3], self.matrix, self.distortion
        )
        return pixels[:, 0], jacobian[:, :6].reshape(-1, 2, 6)

    def as_json(self) -> dict[str, Any]:
        """As a calibration file holds it, with the names that ROS gives."""
        return {
            "image_width": self.size_px[0], "image_height": self.size_px[1],
            "camera_matrix": self.matrix.tolist(),
            "distortion_coefficients": self.distortion.tolist(), "rms_px": self.rms_px,
        }  # fmt: skip


def read_camera(path: Path | None) -> Camera:
    """The camera of a calibration file.

    Raises
    ------
    InputError
        There is none, or it holds something else.
    """
    if path is None:
        raise InputError(
            "A camera without a calibration cannot be trusted to show a wall. Make one: vfplan ar "
            "--board-out BOARD.pdf, then vfplan ar --calibrate PICTURES -o CALIB.json",
            code="camera-uncalibrated",
        )
    text, _ = read_text(path, MAX_CALIBRATION_BYTES, InputError)
    try:
        data = json.loads(text)
        size = int(data["image_width"]), int(data["image_height"])
        matrix = np.array(data["camera_matrix"], float).reshape(3, 3)
        distortion = np.array(data["distortion_coefficients"], float).ravel()
        is_sound = np.isfinite(matrix).all() and np.isfinite(distortion).all() and min(size) > 0
        if not is_sound or len(distortion) not in (4, 5, 8, 12, 14) or matrix[0, 0] <= 0:
            raise ValueError("its numbers are no camera's")
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"is no calibration: {error}. It holds image_width, image_height, camera_matrix and "
            "distortion_coefficients; vfplan ar --calibrate writes one",
            where=str(path), code="calibration-file",
        ) from None  # fmt: skip
    return Camera(size, matrix, distortion, data.get("rms_px"))


@dataclass(frozen=True, eq=False)
class Pose:
    """Where the camera stands before the tags.

    Parameters
    ----------
    T_camera_target
        (4, 4) into the camera's frame: x to the right, y down, z into the picture [m].
    reprojection_px
        Root mean square of what the corners leave over, an axis.
    covariance
        (6, 6) of rotation and translation.
    dof
        Degrees of freedom of the residuals.
    tags
        How many were seen.
    """

    camera: Camera
    target: Target
    T_camera_target: Array
    reprojection_px: float
    covariance: Array
    dof: int
    tags: int

    def project(self, places: Array) -> Array:
        """(N, 2) pixels of places among the tags."""
        return self.camera.project(places, self.T_camera_target)[0]

    def in_view(self, places: Array) -> NDArray[np.bool_]:
        """(N,) whether places lie before the camera and not far beside its picture."""
        x, y, z = (places @ self.T_camera_target[:3, :3].T + self.T_camera_target[:3, 3]).T
        ideal = np.column_stack([x, y, z]) @ self.camera.matrix.T / np.maximum(z, 1e-9)[:, None]
        middle = np.divide(self.camera.size_px, 2)
        return (z > 0) & (np.abs(ideal[:, :2] - middle) < BESIDE * middle).all(axis=1)

    def bound_m(self, places: Array) -> Array:
        """(N,) how far off in the plan's plane each place is at most, with 0.95 [m]."""
        _, jacobian = self.camera.project(places, self.T_camera_target)
        # A step in the plane moves the pixel as the same step of the translation does.
        along = jacobian[:, :, 3:] @ self.T_camera_target[:3, :3] @ self.target.axes
        rows = np.linalg.solve(along, jacobian @ np.linalg.cholesky(self.covariance))
        longest = np.linalg.eigvalsh(rows @ rows.transpose(0, 2, 1))[:, -1]
        # F of 2 and `dof` degrees of freedom has a closed form; the ellipse's longer half axis.
        quantile = self.dof / 2 * (0.05 ** (-2 / self.dof) - 1)
        return np.sqrt(2 * quantile * longest)


def make_finder() -> Any:
    """OpenCV's detector of the tags."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    parameters.adaptiveThreshWinSizeMin = parameters.adaptiveThreshWinSizeMax = WINDOW_PX
    parameters.minMarkerPerimeterRate = MIN_PERIMETER
    return cv2.aruco.ArucoDetector(DICTIONARY, parameters)


def find_tags(finder: Any, grey: Picture) -> dict[int, Array]:
    """Number -> (4, 2) corners [px] of the tags in a grey picture."""
    corners, numbers, _ = finder.detectMarkers(grey)
    if numbers is None:
        return {}
    found = zip(numbers.ravel().tolist(), corners, strict=True)
    return {number: quad[0].astype(float) for number, quad in found}


def locate(found: dict[int, Array], target: Target, camera: Camera) -> Pose:
    """The pose by the tags that were found.

    Raises
    ------
    CheckFailed
        None or one of the plan's tags is seen, another sheet is, or the print is stretched.
    """
    seen = sorted(found.keys() & target.tags.keys())
    others = sorted(found.keys() - target.tags.keys())
    if others and target.is_printed:
        raise CheckFailed(
            f"Tag {others[0]} is not of this plan. Take its sheet: vfplan review --print-out",
            code="other-sheet", numbers={"tags": others},
        )  # fmt: skip
    if len(seen) < MIN_TAGS:
        code = "one-tag" if seen else "no-tag"
        raise CheckFailed(
            f"{len(seen)} tags of this plan are seen. Show {MIN_TAGS} or more", code=code
        )
    places = np.concatenate([target.tags[number] for number in seen])
    pixels = np.concatenate([found[number] for number in seen])
    # Ink, blur and light let the black of all tags grow or shrink alike.
    middles = np.concatenate([np.repeat([target.tags[n].mean(axis=0)], 4, axis=0) for n in seen])
    outward = (places - middles) / np.linalg.norm(places - middles, axis=1, keepdims=True)
    is_found, turns, shifts, errors = cv2.solvePnPGeneric(
        places, pixels, camera.matrix, camera.distortion, flags=cv2.SOLVEPNP_SQPNP
    )
    if not is_found:
        raise CheckFailed("The tags do not lie as they were printed", code="tags-misplaced")
    best = int(np.argmin(errors))
    rotation, shift, growth = turns[best], shifts[best], 0.0
    for _ in range(ITERATIONS):
        T = transform(rotation, shift)
        projected, jacobian = camera.project(places + growth * outward, T)
        along = jacobian[:, :, 3:] @ T[:3, :3]
        grown = along @ outward[:, :, None]
        rows = np.concatenate([jacobian, grown], axis=2).reshape(-1, 7)
        residuals = (pixels - projected).ravel()
        step = np.linalg.lstsq(rows, residuals)[0]
        rotation, shift = rotation + step[:3, None], shift + step[3:6, None]
        growth += step[6]
    residuals -= rows @ step
    refuse_stretched(residuals, rows, along, places)
    variance = float(residuals @ residuals) / (len(residuals) - 7)
    covariance = variance * np.linalg.inv(rows.T @ rows)[:6, :6]
    rms_px = float(np.sqrt(np.mean(residuals**2)))
    T = transform(rotation, shift)
    return Pose(camera, target, T, rms_px, covariance, len(residuals) - 7, len(seen))


def transform(rotation: Array, shift: Array) -> Array:
    """(4, 4) of a rotation vector and a shift, (3, 1) each."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3:] = cv2.Rodrigues(rotation)[0], shift
    return T


def refuse_stretched(residuals: Array, rows: Array, along: Array, places: Array) -> None:
    """Refuse a print that is longer one way than the other, or slanted.

    residuals: (2 N,) what the pose leaves over [px]
    rows: (2 N, p) how they follow from the pose
    along: (N, 2, 3) how they follow from the places (N, 3)
    """
    x, y = places[:, 0, None], places[:, 1, None]
    columns = np.stack([along[:, :, 1] * y, along[:, :, 0] * y + along[:, :, 1] * x], axis=2)
    rows = np.hstack([rows, columns.reshape(-1, 2)])
    inverse = np.linalg.pinv(rows)
    fit = inverse @ residuals
    left = residuals - rows @ fit
    sigma = np.sqrt(left @ left / (len(left) - rows.shape[1]) * np.square(inverse).sum(axis=1))
    is_certain = np.abs(fit) > np.maximum(MAX_STRETCH, CERTAIN * sigma)
    if is_certain[-2:].any():
        raise CheckFailed(
            f"The print is {100 * abs(fit[-2]):.1f} % longer one way than the other. Print it at "
            "100 %, not fitted to the page",
            code="print-stretched", numbers={"stretch": fit[-2], "slant": fit[-1]},
        )  # fmt: skip


def calibrate(pictures: Iterable[Picture]) -> tuple[Camera, int]:
    """A camera by grey pictures of the board from several sides, and how many showed it.

    Raises
    ------
    InputError
        The pictures differ in size, too few show the board, or they do not determine the camera.
    """
    finder = cv2.aruco.CharucoDetector(board())
    views, size = [], None
    for picture in pictures:
        if size not in (None, picture.shape[::-1]):
            raise InputError(
                f"The pictures are of {size} and of {picture.shape[::-1]} pixels. Give pictures of "
                "one camera in one mode",
                code="calibration-sizes",
            )
        size = picture.shape[::-1]
        corners, numbers, _, _ = finder.detectBoard(picture)
        if numbers is not None and len(numbers) >= MIN_CORNERS and len(views) < MAX_PICTURES:
            views.append(board().matchImagePoints(corners, numbers))
    if len(views) < MIN_PICTURES:
        raise InputError(
            f"{len(views)} pictures show the board. Give {MIN_PICTURES} or more, tilted to all "
            "sides, with the board up to the edges of the picture",
            code="calibration-pictures", numbers={"pictures": len(views)},
        )  # fmt: skip
    places, pixels = zip(*views, strict=True)
    rms_px, matrix, distortion, _, _, deviations, _, _ = cv2.calibrateCameraExtended(
        places, pixels, size, None, None
    )
    focal_sigma = float(deviations[:2].max() / matrix[0, 0])
    if focal_sigma > MAX_FOCAL_SIGMA:
        raise InputError(
            f"The pictures leave the focal length open by {100 * focal_sigma:.2f} %. Tilt the "
            "board by 30 degrees to all sides, also near the edges of the picture",
            code="calibration-weak", numbers={"focal_sigma": focal_sigma},
        )  # fmt: skip
    return Camera(size, matrix, distortion.ravel(), float(rms_px)), len(views)
