"""Draw most pictures of the pages:  python docs/make_pictures.py

Slices are photograph-like pictures and go to JPEG. Plots stay PNG.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import cv2

ROOT = Path(__file__).resolve().parents[1]
PICTURES = ROOT / "docs" / "pictures"
SAMPLES = ROOT / "samples"
SLICE = SAMPLES / "elbow.png"
MARKERS = [SAMPLES / "elbow_markers_image.csv", SAMPLES / "elbow_markers_robot.csv"]
VFPLAN = Path(sys.executable).with_name("vfplan")
"""The program, beside this Python."""
JPEG_QUALITY = [cv2.IMWRITE_JPEG_QUALITY, 85]


def main() -> None:
    """Draw one picture after the other."""
    PICTURES.mkdir(exist_ok=True)
    draw_registration()
    draw_surface()
    draw_experiments()
    draw_extraction()
    draw_campaign()
    draw_guidance()
    draw_review()


def draw_review() -> None:
    """The sample's review sheet, and both ends of its line with a box over one of them."""
    with tempfile.TemporaryDirectory() as folder:
        covered = cv2.imread(str(SLICE))
        cv2.rectangle(covered, (730, 640), (800, 690), (96, 96, 96), -1)
        cv2.imwrite(f"{folder}/covered.png", covered)
        sheets = []
        for picture in (SLICE, Path(folder, "covered.png")):
            sheet = f"{folder}/{picture.stem}-sheet.png"
            command = [VFPLAN, "review", picture, *MARKERS, "--pixel-spacing", "0.5"]
            command += ["--margin", "tre95", "--sheet-out", sheet, "-q"]
            subprocess.run(command, check=True)
            sheets.append(cv2.imread(sheet))
    page = cv2.resize(sheets[0], None, fx=0.6, fy=0.6, interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(PICTURES / "review_sheet.jpg"), page, JPEG_QUALITY)
    # The row of insets of the ends begins with the upper edge of the first one's frame.
    is_frame = (sheets[1][1050:, 60:420] < 40).all(axis=(1, 2))
    top = 1050 + int(is_frame.argmax())
    row = sheets[1][top - 110 : top + 372, 40:1620]
    row = cv2.resize(row, None, fx=0.6, fy=0.6, interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(PICTURES / "review_covered.jpg"), row, JPEG_QUALITY)


def draw_guidance() -> None:
    """The sample's curve as a guide of 1 mm, and a hand that swings beside it at 30 mm/s."""
    import numpy as np

    import vfplan
    from vfplan.figures.replay import guide_plot, scene
    from vfplan.figures.style import save_png
    from vfplan.planning.plan import plan
    from vfplan.planning.settings import ExtractSettings, FixtureSettings
    from vfplan.replaying.replay import replay
    from vfplan.session.session import Session

    fixture = plan(
        SLICE,
        *MARKERS,
        extraction=ExtractSettings(pixel_spacing_mm=(0.5, 0.5)),
        settings=FixtureSettings(guide_m=1e-3),
    ).fixture
    guide = vfplan.Guide.of(fixture)
    t = np.arange(0, guide.lengths_m[0] / 0.03, 1e-3)
    places = guide.at(0.03 * t)
    tangent = np.gradient(places, axis=0)
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0], 0 * t])
    normal /= np.linalg.norm(tangent, axis=1)[:, None]
    swing = 2.2e-3 * np.sin(2.83 * t) * np.sin(0.38 * t) + 1e-4 * np.sin(56.5 * t)
    hips = places + swing[:, None] * normal + [0, 0, fixture.points[0, 2]]
    replayed = replay(fixture, Session(t, hips))
    save_png(guide_plot(replayed), PICTURES / "guide_lateral.png")
    figure = scene(replayed)
    figure.axes[0].set_xlim(465, 600)
    figure.axes[0].set_ylim(-115, -20)
    save_png(figure, PICTURES / "guide_scene.png")


def draw_experiments() -> None:
    """The paper's two experiments; the slice, a photograph-like picture, goes to JPEG."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([VFPLAN, "demo", "experiments", "-o", folder, "-q"], check=True)
        for path in Path(folder).glob("experiment-*.png"):
            if "slice" in path.name:
                target = str(PICTURES / path.with_suffix(".jpg").name)
                cv2.imwrite(target, cv2.imread(str(path)), JPEG_QUALITY)
            else:
                (PICTURES / path.name).write_bytes(path.read_bytes())


def draw_campaign() -> None:
    """The campaign of docs/campaigns.md, on the shipped sample."""
    with tempfile.TemporaryDirectory() as folder:
        plan = [VFPLAN, "plan", SLICE, *MARKERS, "-o", f"{folder}/f.h5"]
        plan += ["--pixel-spacing", "0.5", "-q"]
        subprocess.run(plan, check=True)
        campaign = [VFPLAN, "campaign", f"{folder}/f.h5", SAMPLES / "elbow_session.csv"]
        campaign += ["-o", f"{folder}/c", "--trials", "640", "--beyond", "2.8"]
        campaign += ["--picture-out", PICTURES / "campaign.png", "--overwrite", "-q"]
        subprocess.run(campaign, check=True)


def draw_registration() -> None:
    """The registration's picture, from the shipped sample."""
    with tempfile.TemporaryDirectory() as folder:
        plan = [VFPLAN, "plan", SLICE, *MARKERS, "-o", f"{folder}/f.h5"]
        plan += ["--pixel-spacing", "0.5", "--picture-out", f"{folder}/p.png", "-q"]
        subprocess.run(plan, check=True)
        target = str(PICTURES / "registration.jpg")
        cv2.imwrite(target, cv2.imread(f"{folder}/p.png"), JPEG_QUALITY)


def draw_surface() -> None:
    """The surface of the sample bone, from its outlines."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, SAMPLES / "make_bone.py"], check=True, cwd=folder)
        surface = [VFPLAN, "surface", "bone.mrk.json", "-o", "b.h5", "--picture-out", "p.png", "-q"]
        subprocess.run(surface, check=True, cwd=folder)
        target = str(PICTURES / "surface.jpg")
        cv2.imwrite(target, cv2.imread(f"{folder}/p.png"), JPEG_QUALITY)


def draw_extraction() -> None:
    """The sample's mask, and an overlay of the sample with other red marks drawn on it."""
    red = (0, 0, 255)
    busy = cv2.imread(str(SLICE))
    cv2.putText(busy, "PLAN A", (30, 760), cv2.FONT_HERSHEY_SIMPLEX, 1, red, 2, cv2.LINE_AA)
    cv2.arrowedLine(busy, (840, 200), (770, 260), red, 3, cv2.LINE_AA, 0, 0.25)
    cv2.rectangle(busy, (30, 30), (60, 50), red, -1)
    cv2.rectangle(busy, (30, 560), (150, 640), red, 2)
    with tempfile.TemporaryDirectory() as folder:
        picture = f"{folder}/busy.png"
        cv2.imwrite(picture, busy)
        extract = [VFPLAN, "extract", picture, "-o", f"{folder}/c.h5"]
        extract += ["--mask-out", f"{folder}/m.png", "--overlay-out", f"{folder}/o.png", "-q"]
        subprocess.run(extract, check=True)
        (PICTURES / "extraction_mask.png").write_bytes(Path(folder, "m.png").read_bytes())
        target = str(PICTURES / "extraction_overlay.jpg")
        cv2.imwrite(target, cv2.imread(f"{folder}/o.png"), JPEG_QUALITY)


if __name__ == "__main__":
    main()
