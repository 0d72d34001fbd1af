"""The overlay: a length in mm, the patient's sides, and numbers where there is a choice."""

from __future__ import annotations

import numpy as np
import pytest
from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar

from vfplan import PlannedImage
from vfplan.curve.extraction import vector_stroke
from vfplan.errors import CurveError
from vfplan.figures import slice as picture
from vfplan.figures import style
from vfplan.findings import doubt
from vfplan.fixture import Stroke
from vfplan.images.read import side_of_patient

WAY = np.column_stack([np.linspace(50, 350, 60), np.full(60, 200.0)])


@pytest.fixture
def drawn(monkeypatch, tmp_path):
    kept = []
    monkeypatch.setattr(style, "save_png", lambda figure, path: kept.append(figure))

    def draw(image, **given):
        if "lines" in given:
            error = CurveError("several", code="several-candidates")
            error.lines, error.forked = given["lines"], given.get("forked", ())
            error.numbers.update(given.get("place", {}))
            picture.draw_refusal(image, error, tmp_path / "p.png")
        else:
            stroke = vector_stroke(Stroke(WAY, False), image, "w")
            picture.draw_overlay(image, stroke, tmp_path / "p.png")
        return kept[-1].axes[0]

    return draw


def sagittal():
    """u runs to the back, v to the feet, as a sagittal slice of DICOM lies."""
    place = np.zeros((4, 3))
    place[1, 0], place[2, 1], place[3, 2] = 0.5e-3, -0.7e-3, 1
    return PlannedImage(np.full((300, 400, 3), 90, np.uint8), (0.5, 0.7), "", place)


def test_bar_is_as_long_as_it_says(drawn):
    [bar] = drawn(sagittal()).findobj(AnchoredSizeBar)
    assert bar.txt_label.get_text() == "20 mm"
    assert bar.size_bar.get_children()[0].get_width() * 0.5 == pytest.approx(20)
    bare = drawn(PlannedImage(np.zeros((300, 400, 3), np.uint8)))
    assert not bare.findobj(AnchoredSizeBar)
    assert not any(t.get_text() in [*"LRAPHF"] for t in bare.texts)


def test_sides_are_the_patients(drawn):
    places = {t.get_position(): t.get_text() for t in drawn(sagittal()).texts}
    sides = {(0.98, 0.5): "P", (0.02, 0.5): "A", (0.5, 0.03): "F", (0.5, 0.97): "H"}
    assert sides.items() <= places.items()
    for way, name in (((1.0, 0, 0.2), "L"), ((0.5, -0.8, 0), "AL"), ((-0.5, 0.8, 0), "PR")):
        assert side_of_patient(np.array(way)) == name


def test_candidates_have_the_numbers_that_stroke_takes(drawn):
    lines = tuple(np.add(WAY, [0, 30 * k]) for k in range(7))
    axes = drawn(sagittal(), lines=lines, forked=(2,))
    legend = [text.get_text() for text in axes.figure.legends[0].get_texts()]
    assert legend[:3] == ["--stroke 1", "2: page only", "--stroke 3"]
    numbers = {t.get_text(): tuple(t.xy) for t in axes.texts if t.get_text().isdigit()}
    assert numbers == {str(k): tuple(line[0]) for k, line in enumerate(lines, 1)}


def test_overlay_leaves_the_ink_as_it_is(tmp_path):
    import cv2
    from drawing import blend, coverage, to_uint8

    from vfplan.curve.extraction import extract_curve

    line = np.column_stack([np.linspace(60, 840, 400), 300 + 120 * np.sin(np.linspace(0, 6, 400))])
    ground = np.full((600, 900, 3), 90.0)
    image = to_uint8(blend(ground, coverage(ground.shape[:2], line, 4.0), (255, 0, 0)))
    found = doubt("ink-left", "extract", "Ink is left.", place_px=(200.0, 100.0))
    path = tmp_path / "overlay.png"
    picture.draw_overlay(PlannedImage(image), extract_curve(image), path, findings=[found])
    seen = cv2.imread(str(path))[:, :, ::-1]
    rows, columns = np.rint(line[:, 1]).astype(int), np.rint(line[:, 0]).astype(int)
    assert np.abs(seen[rows, columns].astype(int) - image[rows, columns]).max() <= 12
    # Away from outline and captions the greys are the slice's own.
    assert (seen[450:590, 300:800] == 90).mean() > 0.99


def test_a_refusal_shows_its_place_and_its_code(drawn):
    axes = drawn(sagittal(), lines=(), place={"u_px": 120.0, "v_px": 80.0})
    (text,) = (t for t in axes.texts if t.get_text() == "several-candidates")
    assert text.xy == (120.0, 80.0)
