"""Every kind of image that may hold a planned slice, and every way it may be broken."""

from __future__ import annotations

import hashlib

import cv2
import numpy as np
import pytest
import tifffile
from captures import CURVE, PICTURE, SHAPE
from drawing import blend, coverage, flat, rms_off
from PIL import Image, ImageOps

import vfplan
from vfplan.errors import ImageError


def saved(tmp_path, form, image=None, **options):
    path = tmp_path / f"slice.{form.lower()}"
    (Image.fromarray(PICTURE) if image is None else image).save(path, form, **options)
    return path


@pytest.mark.parametrize("form", ["PNG", "TIFF", "BMP"])
def test_lossless_formats_hold_the_same_pixels(tmp_path, form):
    read = vfplan.read_image(saved(tmp_path, form))
    assert np.array_equal(read.rgb, PICTURE)
    assert (read.width_px, read.height_px) == SHAPE[::-1]


@pytest.mark.parametrize("form", ["png", "tiff"])
def test_sixteen_bits_are_kept_and_extracted_alike(tmp_path, form):
    fine = blend(flat(SHAPE, 180), coverage(SHAPE, CURVE, 3), (230, 20, 40)) * 257
    path = tmp_path / f"slice.{form}"
    assert cv2.imwrite(str(path), np.rint(fine[..., ::-1]).astype(np.uint16))
    read = vfplan.read_image(path)
    assert read.rgb.dtype == np.uint16
    (deep,) = vfplan.extract_curve(read).strokes
    assert rms_off(deep, CURVE) < 0.03


def test_palette(tmp_path):
    few = Image.fromarray(PICTURE).quantize(64)
    read = vfplan.read_image(saved(tmp_path, "PNG", few))
    assert np.array_equal(read.rgb, np.array(few.convert("RGB")))


@pytest.mark.parametrize("mode", ["RGB", "L", "P"])
def test_transparent_pixels_lie_over_black(tmp_path, mode):
    image, options = Image.fromarray(PICTURE).convert(mode), {}
    if mode == "P":
        options["transparency"] = int(np.array(image)[0, 0])
    else:
        alpha = np.full(SHAPE, 255, np.uint8)
        alpha[:20] = 0
        image.putalpha(Image.fromarray(alpha))
    path = saved(tmp_path, "PNG", image, **options)
    shown = Image.open(path).convert("RGBA")
    shown = Image.alpha_composite(Image.new("RGBA", shown.size, "black"), shown).convert("RGB")
    read = vfplan.read_image(path).rgb
    assert not read[0, 0].any()
    assert np.array_equal(read, shown)


@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
def test_a_half_transparent_pixel_is_rounded_to_the_nearest_value(tmp_path, depth):
    full = np.iinfo(depth).max
    bgra = np.random.default_rng(1).integers(0, full, (37, 11, 4), depth, endpoint=True)
    path = tmp_path / "slice.png"
    assert cv2.imwrite(str(path), bgra)
    exact = bgra[..., 2::-1].astype(float) * bgra[..., 3:].astype(float) / full
    assert np.array_equal(vfplan.read_image(path).rgb, np.rint(exact))


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_samples_that_are_no_whole_numbers_are_refused(tmp_path, channels):
    path = tmp_path / "slice.tif"
    assert cv2.imwrite(str(path), np.zeros((9, 7, channels), np.float32))
    with pytest.raises(ImageError, match="float32 samples"):
        vfplan.read_image(path)


@pytest.mark.parametrize("form", ["JPEG", "PNG", "TIFF", "RGBA"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_exif_orientation_is_applied(tmp_path, form, orientation):
    exif = Image.Exif()
    exif[0x0112] = orientation
    image = Image.fromarray(PICTURE)
    if form == "RGBA":
        image.putalpha(255)
    path = saved(tmp_path, form.replace("RGBA", "PNG"), image, exif=exif)
    upright = np.array(ImageOps.exif_transpose(Image.open(path)).convert("RGB")).astype(int)
    read = vfplan.read_image(path).rgb
    assert read.shape == upright.shape
    assert np.abs(read - upright).mean() < 3


# What EXIF's orientations do to a picture (TIFF 6.0, page 36).
TURNS = [
    lambda p: p, np.fliplr, lambda p: np.rot90(p, 2), np.flipud, lambda p: p.swapaxes(0, 1),
    lambda p: np.rot90(p, -1), lambda p: np.rot90(p.swapaxes(0, 1), 2), np.rot90,
]  # fmt: skip
LAYOUTS = {
    "strips": {"rowsperstrip": 7}, "one strip": {"rowsperstrip": 1000}, "tiles": {"tile": (64, 64)},
    "deflate": {"compression": "zlib"}, "tiles, deflate": {"tile": (32, 16), "compression": "zlib"},
    "planes": {"planarconfig": "separate"}, "big": {"bigtiff": True, "tile": (64, 64)},
    "motorola": {"byteorder": ">", "tile": (64, 64)},
}  # fmt: skip


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_tiff_of_any_layout_is_turned_as_it_says(tmp_path, layout, orientation):
    path = tmp_path / "a.tif"
    for depth in (np.uint8, np.uint16):
        stored = np.random.default_rng(orientation).integers(
            0, np.iinfo(depth).max, (60, 90, 3), depth, endpoint=True
        )
        stored[0, 0] = np.iinfo(depth).max
        written = np.moveaxis(stored, 2, 0) if layout == "planes" else stored
        tag = [(0x0112, "H", 1, orientation, True)]
        tifffile.imwrite(path, written, photometric="rgb", extratags=tag, **LAYOUTS[layout])
        if layout == "planes" and depth == np.uint16:
            with pytest.raises(ImageError, match="planes of colours"):
                vfplan.read_image(path)
            continue
        read = vfplan.read_image(path)
        assert np.array_equal(read.rgb, TURNS[orientation - 1](stored))
        assert read.orientation == orientation
        as_stored = vfplan.read_image(path, pixels="as-stored")
        assert np.array_equal(as_stored.rgb, stored)
        assert (as_stored.orientation, as_stored.findings) == (1, ())


def codes(read):
    return [finding.code for finding in read.findings]


@pytest.mark.parametrize("tile", [None, (64, 64)])
@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
@pytest.mark.parametrize("extra", ["unspecified", "assocalpha", "unassalpha"])
def test_a_sample_beside_the_colours_is_a_mask_only_where_it_says_so(tmp_path, extra, depth, tile):
    full = np.iinfo(depth).max
    stored = np.random.default_rng(1).integers(0, full, (60, 90, 4), depth, endpoint=True)
    stored[0, 0] = full
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, stored, photometric="rgb", extrasamples=[extra], tile=tile)
    read, colours = vfplan.read_image(path), stored[..., :3]
    if extra == "unassalpha":
        colours = np.rint(colours * (stored[..., 3:].astype(float) / full))
    assert np.abs(read.rgb - colours.astype(float)).max() <= (extra == "unassalpha")
    assert codes(read) == (["extra-sample"] if extra == "unspecified" else [])


def test_a_bmp_whose_alpha_is_nothing_is_opaque(tmp_path):
    for alpha in (0, 255):
        bgra = np.dstack([PICTURE[..., ::-1], np.full(SHAPE, alpha, np.uint8)])
        assert cv2.imwrite(str(tmp_path / "a.bmp"), bgra)
        assert np.array_equal(vfplan.read_image(tmp_path / "a.bmp").rgb, PICTURE)
        assert vfplan.read_image(tmp_path / "a.bmp").findings == ()


@pytest.mark.parametrize("form", ["PNG", "JPEG"])
def test_what_follows_a_picture_is_left_out_with_a_note(tmp_path, form):
    path = saved(tmp_path, form, progressive=True)
    alone = vfplan.read_image(path)
    film = b"\0\0\0\x18ftypmp42" + bytes(range(256)) * 40
    with path.open("ab") as file:
        file.write(film)
    read = vfplan.read_image(path)
    assert np.array_equal(read.rgb, alone.rgb)
    assert (codes(alone), codes(read)) == ([], ["data-behind-end"])


def test_a_picture_of_12_bits_in_16_is_stretched_with_a_note(tmp_path):
    path = tmp_path / "a.png"
    assert cv2.imwrite(str(path), PICTURE[..., ::-1].astype(np.uint16) << 4)
    read = vfplan.read_image(path)
    assert np.array_equal(read.rgb, PICTURE.astype(np.uint16) << 8)
    assert codes(read) == ["range-stretched"]
    assert rms_off(vfplan.extract_curve(read).strokes[0], CURVE) < 0.03


@pytest.mark.parametrize("form", ["PNG", "JPEG", "TIFF", "BMP"])
@pytest.mark.parametrize("kept", [0.0, 0.05, 0.5, 0.9, 0.98])
def test_truncated_files_are_refused(tmp_path, form, kept, capfd):
    path = saved(tmp_path, form)
    data = path.read_bytes()
    path.write_bytes(data[: int(kept * len(data))])
    with pytest.raises(ImageError):
        vfplan.read_image(path)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("at", [0.3, 0.6, 0.9])
@pytest.mark.parametrize("damage", ["cut short, end marker kept", "marker in the data"])
def test_a_jpeg_that_its_decoder_would_fill_in_is_refused(tmp_path, at, damage, capfd):
    path = saved(tmp_path, "JPEG")
    data = path.read_bytes()
    start = data.index(b"\xff\xda")  # what comes after is the picture
    cut = start + int(at * (len(data) - start))
    rest = data[cut + 4 :] if damage == "marker in the data" else b""
    path.write_bytes(data[:cut] + (b"\xff\xc1xx" + rest if rest else b"\xff\xd9"))
    with pytest.raises(ImageError, match="the JPEG is damaged: "):
        vfplan.read_image(path)
    assert capfd.readouterr().err == ""


def test_what_is_no_image_is_refused(tmp_path):
    (tmp_path / "text.png").write_text("not a picture")
    said = {"absent.png": "no such file", ".": "directory", "text.png": "is no PNG, JPEG"}
    for name, words in said.items():
        with pytest.raises(ImageError, match=words):
            vfplan.read_image(tmp_path / name)


def test_a_curve_is_extracted_from_a_file_an_image_or_its_pixels_alike(tmp_path):
    path = saved(tmp_path, "PNG")
    read = vfplan.read_image(path)
    first, *others = (vfplan.extract_curve(given).strokes[0].points_px
                      for given in (path, str(path), read, read.rgb))  # fmt: skip
    assert all(np.array_equal(other, first) for other in others)
    with pytest.raises(ImageError, match="no such file"):
        vfplan.extract_curve(tmp_path / "absent.png")
    with pytest.raises(ImageError, match=r"\(H, W, 3\)"):
        vfplan.extract_curve(read.rgb[..., 0])


def test_the_hash_is_that_of_the_file_and_the_callers_spacing_wins(tmp_path):
    path = saved(tmp_path, "PNG")
    read = vfplan.read_image(path, pixel_spacing_mm=(0.5, 0.6))
    assert read.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert read.pixel_spacing_mm == (0.5, 0.6)
