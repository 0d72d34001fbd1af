"""Images made to fill memory or time are refused by their headers; the largest honest ones pass."""

from __future__ import annotations

import resource
import struct
import subprocess
import sys
import time
import zlib
from contextlib import contextmanager

import cv2
import numpy as np
import pytest
from conftest import ROOT, file_with, output
from motion import PEAK_KIB
from refusals import refuses

from vfplan import read_image
from vfplan.errors import ImageError, SettingError
from vfplan.images.raster import MAX_TIFF_PARTS
from vfplan.images.read import LARGEST_MEGAPIXELS

GIB = 1 << 30


def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(width, height, colour=2, *extra, rows=None):
    """A PNG that says its size; its pixels are `rows` bytes of zeros, deflated."""
    head = struct.pack(">IIBBBBB", width, height, 8, colour, 0, 0, 0)
    return png_of(head, zlib.compress(bytes(rows or 1), 1), *extra)


def png_of(head, data, *extra):
    parts = [chunk(b"IHDR", head), *extra, chunk(b"IDAT", data), chunk(b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def tiff(pages, width=32, height=32, after=None):
    """Pages of one strip each; `after`: where the last directory goes on to."""
    data, strip = b"II*\0" + struct.pack("<I", 8), 8 + pages * (2 + 8 * 12 + 4)
    for k in range(pages):
        tags = ((256, width), (257, height), (258, 8), (259, 1), (262, 1), (273, strip),
                (277, 1), (279, width * height))  # fmt: skip
        data += struct.pack("<H", len(tags))
        data += b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in tags)
        end = after if after is not None else 0
        data += struct.pack("<I", end if k == pages - 1 else len(data) + 4)
    return data + bytes(min(width * height, 4096))


def jpeg(width, height, scans=1):
    good = cv2.imencode(".jpg", np.zeros((8, 8, 3), np.uint8))[1].tobytes()
    at = good.index(b"\xff\xc0")
    good = good[: at + 5] + struct.pack(">HH", height, width) + good[at + 9 :]
    return good[:-2] + b"\xff\xda\0\2" * (scans - 1) + good[-2:]


def bmp(width, height):
    good = bytearray(cv2.imencode(".bmp", np.zeros((8, 8, 3), np.uint8))[1].tobytes())
    good[18:26] = struct.pack("<ii", width, height)
    return bytes(good)


FILM = chunk(b"acTL", struct.pack(">II", 9999, 0))
BOMBS = {
    "wide.png": (lambda: png(32000, 32000, rows=3_000_000), "32000 x 32000 pixels"),
    "alpha.png": (lambda: png(32000, 32000, 6), "32000 x 32000 pixels"),
    "nothing.png": (lambda: png(0, 5), "0 x 5 pixels"),
    "film.png": (lambda: png(64, 64, 6, FILM), "9999 frames"),
    "wide.jpg": (lambda: jpeg(65000, 65000), "65000 x 65000 pixels"),
    "scans.jpg": (lambda: jpeg(4096, 4096, 5000), "more than 200 scans"),
    "wide.bmp": (lambda: bmp(40000, -40000), "40000 x 40000 pixels"),
    "thin.bmp": (lambda: bmp(-5, 5), "Export the slice again"),
    "wide.tif": (lambda: tiff(1, 60000, 60000), "60000 x 60000 pixels"),
    "pages.tif": (lambda: tiff(MAX_TIFF_PARTS + 1), "more than 4096 pages"),
    "circle.tif": (lambda: tiff(3, after=8), "more than 4096 pages"),
    "cut.tif": (lambda: tiff(3, after=1 << 30), "damaged or cut short"),
    "cut.jpg": (lambda: jpeg(8, 8)[:40] + b"\xff\xd9", "damaged or cut short"),
    "a.webp": (lambda: b"RIFF\x1a\0\0\0WEBPVP8L" + bytes(20), "is no PNG, JPEG, TIFF"),
    "a.jp2": (lambda: b"\0\0\0\x0cjP  \r\n\x87\n" + bytes(40), "is no PNG, JPEG, TIFF"),
    "a.ppm": (lambda: b"P6\n4 4\n255\n" + bytes(48), "is no PNG, JPEG, TIFF"),
    "a.ras": (lambda: b"\x59\xa6\x6a\x95" + bytes(60), "is no PNG, JPEG, TIFF"),
    "a.avif": (lambda: b"\0\0\0\x1cftypavif" + bytes(60), "is no PNG, JPEG, TIFF"),
    "a.hdr": (lambda: b"#?RADIANCE\n\n-Y 4 +X 4\n" + bytes(60), "is no PNG, JPEG"),
}


@contextmanager
def cheap():
    """The block takes less than ten seconds of processor time and a gigabyte."""
    before, began = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    yield
    assert time.process_time() - began < 10
    assert 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) < GIB


@pytest.mark.parametrize("name", BOMBS)
def test_what_would_fill_memory_is_refused_by_its_header(tmp_path, name):
    make, message = BOMBS[name]
    (tmp_path / name).write_bytes(make())
    with cheap(), pytest.raises(ImageError, match=message):
        read_image(tmp_path / name)


def test_a_page_of_many_is_read_alone(tmp_path):
    """3000 pages once took 4 GB."""
    (tmp_path / "a.tif").write_bytes(tiff(3000, 64, 64))
    with pytest.raises(ImageError, match=r"has 3000 pages. Choose one"):
        read_image(tmp_path / "a.tif")
    assert read_image(tmp_path / "a.tif", frame=2999).rgb.shape == (64, 64, 3)
    for frame in (3001, 0, -1):
        with pytest.raises(ImageError, match=f"has no page {frame}."):
            read_image(tmp_path / "a.tif", frame=frame)


LARGE = """
import sys, numpy as np
from vfplan.images.read import read_image
image = read_image(sys.argv[1], max_megapixels=268.5)
print(image.rgb.shape, int(image.rgb[5, 7, 0]))
import resource, time
print(f"{time.process_time():.1f} s, {resource.getrusage(0).ru_maxrss >> 10} MiB", file=sys.stderr)
"""


@pytest.mark.full
@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tif", ".bmp", ".dcm"])
def test_the_largest_slices_are_read(tmp_path, suffix):
    side = int((1e6 * LARGEST_MEGAPIXELS) ** 0.5)
    image, path = np.full((side, side, 3), 200, np.uint8), tmp_path / f"a{suffix}"
    if suffix == ".dcm":
        from captures import capture

        path = capture(tmp_path, image)
    else:
        assert cv2.imwrite(str(path), image)
    del image
    words = [sys.executable, "-c", LARGE, path]
    done = subprocess.run(words, capture_output=True, text=True, cwd=tmp_path, check=True)
    assert done.stdout.strip() == f"({side}, {side}, 3) 200"
    print(suffix, done.stderr)  # what docs/security.md says


# --- DICOM -------------------------------------------------------------------------------------

ENDLESS = b"\xff\xff\xff\xff"  # a length that is found by its end
SEQUENCE = b"\x09\0\x10\0SQ\0\0" + ENDLESS
PIXELS = b"\xe0\x7f\x10\0OB\0\0"


def element(tag, kind, value):
    """One with a short length."""
    return struct.pack("<HH2sH", *tag, kind, len(value)) + value


def dicom(syntax=b"1.2.840.10008.1.2.1", body=b"", pixels=None, frames=b"", deflate=0):
    """A capture of 8 x 8 pixels, with what is made up in `body`, before the pixels."""
    kind = b"1.2.840.10008.5.1.4.1.1.7"
    meta = [((2, 2), b"UI", kind + b"\0"), ((2, 3), b"UI", b"1.23"),
            ((2, 16), b"UI", syntax + b"\0" * (len(syntax) % 2))]  # fmt: skip
    meta = b"".join(element(*item) for item in meta)
    short = {6: 0, 16: 8, 17: 8, 256: 8, 257: 8, 258: 7, 259: 0}
    head = element((40, 2), b"US", struct.pack("<H", 3)) + element((40, 4), b"CS", b"RGB ")
    head += frames
    head += b"".join(element((40, k), b"US", struct.pack("<H", short[k])) for k in short)
    pixels = PIXELS + struct.pack("<I", 192) + bytes(192) if pixels is None else pixels
    content = body + head + pixels
    if deflate:
        packer = zlib.compressobj(1, wbits=-zlib.MAX_WBITS)
        parts = [packer.compress(content)]
        parts += [packer.compress(bytes(1 << 22)) for _ in range(deflate >> 22)]
        content = b"".join(parts) + packer.flush()
    length = element((2, 0), b"UL", struct.pack("<I", len(meta)))
    return bytes(128) + b"DICM" + length + meta + content


def fragment(data):
    """Pixels of one frame, compressed."""
    parts = b"", data + b"\0" * (len(data) % 2)
    items = b"".join(b"\xfe\xff\x00\xe0" + struct.pack("<I", len(x)) + x for x in parts)
    return PIXELS + ENDLESS + items + b"\xfe\xff\xdd\xe0" + bytes(4)


def many_elements(count):
    tags = (struct.pack("<HH2sH", 9 + 2 * (k >> 15), 0x1000 + (k & 0x7FFF), b"LO", 0)
            for k in range(count))  # fmt: skip
    return b"".join(tags)


def runs(count):
    """RLE: three segments, each of so many runs of 128 equal bytes."""
    segment = b"\x81\0" * count
    head = struct.pack("<16I", 3, *(64 + k * len(segment) for k in range(3)), *[0] * 12)
    return fragment(head + 3 * segment)


RLE, JPEG, J2K = (b"1.2.840.10008.1.2.5", b"1.2.840.10008.1.2.4.50", b"1.2.840.10008.1.2.4.91")
ITEM = b"\xfe\xff\x00\xe0" + bytes(4)
NUMBERS = struct.pack("<HH2sHI", 40, 0x30, b"UN", 0, 80_000_000) + b"1\\" * 40_000_000
CAPTURES = {
    "deflated": lambda: dicom(b"1.2.840.10008.1.2.1.99", deflate=1 << 32),
    "elements": lambda: dicom(body=many_elements(5_000_000)),
    "items": lambda: dicom(body=SEQUENCE + 5_000_000 * ITEM),
    "nested": lambda: dicom(body=300_000 * (SEQUENCE + ITEM[:4] + ENDLESS)),
    "numbers": lambda: dicom(body=NUMBERS),
    "frames": lambda: dicom(frames=element((40, 8), b"IS", b"999999999999")),
    "fragments": lambda: dicom(RLE, pixels=PIXELS + ENDLESS + 4_000_000 * ITEM,
                               frames=element((40, 8), b"IS", b"4000000 ")),
    "runs": lambda: dicom(RLE, pixels=runs(20_000_000)),
    "wide.jpg": lambda: dicom(JPEG, pixels=fragment(jpeg(65000, 65000))),
    "j2k": lambda: dicom(J2K, pixels=fragment(wide_jpeg2000())),
}  # fmt: skip


def wide_jpeg2000():
    """Its header says 60000 x 60000 pixels."""
    good = cv2.imencode(".jp2", np.zeros((64, 64, 3), np.uint8))[1].tobytes()
    stream = bytearray(good[good.index(b"\xff\x4f\xff\x51") :])
    for at in (8, 12, 24, 28):  # the picture, and its one tile
        stream[at : at + 4] = struct.pack(">I", 60000)
    return bytes(stream)


def test_a_small_capture_is_read(tmp_path):
    for data in (dicom(), dicom(b"1.2.840.10008.1.2.1.99", deflate=1)):
        assert read_image(file_with(tmp_path / "a.dcm", data)).rgb.shape == (8, 8, 3)


QUICK = ("items", "wide.jpg")


@pytest.mark.parametrize(
    "name", [*QUICK, *(pytest.param(n, marks=pytest.mark.full) for n in CAPTURES if n not in QUICK)]
)
def test_a_capture_made_to_fill_memory_or_time_is_refused(tmp_path, name, monkeypatch):
    """Its reader has limits of its own: here 2 s of 8, to save time."""
    monkeypatch.setattr("vfplan.io.sandbox.STEP_S", 2)
    (tmp_path / "a.dcm").write_bytes(CAPTURES[name]())
    with cheap(), pytest.raises(ImageError):
        read_image(tmp_path / "a.dcm")


def test_a_picture_is_read_where_there_is_no_stderr():
    code = "import os, vfplan; os.close(2); print(vfplan.read_image('samples/elbow.png').width_px)"
    assert int(output(sys.executable, "-c", code, cwd=ROOT)) > 0


BOMB = f"""
import sys, time
from vfplan.errors import ImageError
from vfplan.images.read import read_image
try:
    read_image(sys.argv[1])
    print("read")
except ImageError as error:
    print(error.code)
print({PEAK_KIB} >> 10, time.process_time())
"""


@pytest.mark.parametrize(
    "side, said",
    [(9000, "image-too-large"), pytest.param(7999, "read", marks=pytest.mark.full)],
)
def test_the_worst_picture_is_refused_or_stays_within_memory(tmp_path, side, said):
    """A square of 16-bit RGBA in a PNG of a few kilobytes."""
    packer = zlib.compressobj(9)
    rows = b"".join(packer.compress(bytes(1 + 8 * side)) for _ in range(side)) + packer.flush()
    head = struct.pack(">IIBBBBB", side, side, 16, 6, 0, 0, 0)
    bomb = file_with(tmp_path / "bomb.png", png_of(head, rows))
    result, memory, seconds = output(sys.executable, "-c", BOMB, bomb, cwd=tmp_path).split()
    assert result == said
    assert int(memory) < 1536  # a fork begins with the memory of its parent
    assert float(seconds) < 5


def test_more_megapixels_are_read_where_the_caller_says_so(tmp_path):
    path = tmp_path / "a.png"
    assert cv2.imwrite(str(path), np.zeros((100, 100, 3), np.uint8))
    with refuses(ImageError, "image-too-large", width_px=100, height_px=100, max_pixels=9000):
        read_image(path, max_megapixels=0.009)
    assert read_image(path, max_megapixels=0.01).width_px == 100
    with refuses(SettingError, "out-of-range"):
        read_image(path, max_megapixels=1e6)
