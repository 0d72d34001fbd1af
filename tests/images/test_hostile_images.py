"""Images made to fill memory or time are refused by their headers; the largest honest ones pass."""

from __future__ import annotations

import io
import resource
import struct
import subprocess
import sys
import time
import zlib

import cv2
import numpy as np
import pytest

from vfplan.errors import ImageError
from vfplan.images.header import MOST_PAGES, MOST_PIXELS, read_header
from vfplan.images.read import read_image

GIB = 1 << 30


def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(width, height, colour=2, *extra, rows=None):
    """A PNG that says its size; its pixels are `rows` bytes of zeros, deflated."""
    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, colour, 0, 0, 0))
    body = chunk(b"IDAT", zlib.compress(bytes(rows or 1), 1))
    return b"\x89PNG\r\n\x1a\n" + head + b"".join(extra) + body + chunk(b"IEND", b"")


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


BOMBS = {
    "wide.png": (lambda: png(32000, 32000, rows=3_000_000), "at most 268435456 are read"),
    "alpha.png": (lambda: png(32000, 32000, 6), "32000 x 32000 pixels"),
    "nothing.png": (lambda: png(0, 5), "0 x 5 pixels"),
    "film.png": (lambda: png(64, 64, 6, chunk(b"acTL", struct.pack(">II", 9999, 0))), "animated"),
    "wide.jpg": (lambda: jpeg(65000, 65000), "65000 x 65000 pixels"),
    "scans.jpg": (lambda: jpeg(4096, 4096, 5000), "5000 scans"),
    "wide.bmp": (lambda: bmp(40000, -40000), "40000 x 40000 pixels"),
    "thin.bmp": (lambda: bmp(-5, 5), "pixels; at least one"),
    "wide.tif": (lambda: tiff(1, 60000, 60000), "60000 x 60000 pixels"),
    "pages.tif": (lambda: tiff(MOST_PAGES + 1), "more than 4096 pages"),
    "circle.tif": (lambda: tiff(3, after=8), "more than 4096 pages"),
    "cut.tif": (lambda: tiff(3, after=1 << 30), "damaged or cut short"),
    "cut.jpg": (lambda: jpeg(8, 8)[:40] + b"\xff\xd9", "damaged or cut short"),
    "a.webp": (lambda: b"RIFF\x1a\0\0\0WEBPVP8L" + bytes(20), "is not an image that can be read"),
    "a.jp2": (lambda: b"\0\0\0\x0cjP  \r\n\x87\n" + bytes(40), "is not an image that can be read"),
    "a.ppm": (lambda: b"P6\n4 4\n255\n" + bytes(48), "is not an image that can be read"),
    "a.ras": (lambda: b"\x59\xa6\x6a\x95" + bytes(60), "is not an image that can be read"),
    "a.avif": (lambda: b"\0\0\0\x1cftypavif" + bytes(60), "is not an image that can be read"),
    "a.hdr": (lambda: b"#?RADIANCE\n\n-Y 4 +X 4\n" + bytes(60), "is not an image that can be"),
}


@pytest.mark.parametrize("name", BOMBS)
def test_what_would_fill_memory_is_refused_by_its_header(tmp_path, name):
    make, message = BOMBS[name]
    (tmp_path / name).write_bytes(make())
    before, began = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    with pytest.raises(ImageError, match=message):
        read_image(tmp_path / name)
    assert time.process_time() - began < 10
    assert 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) < GIB


def test_a_page_of_many_is_read_alone(tmp_path):
    """3000 pages once took 4 GB."""
    (tmp_path / "a.tif").write_bytes(tiff(3000, 64, 64))
    with pytest.raises(ImageError, match="has 3000 pages; choose one"):
        read_image(tmp_path / "a.tif")
    assert read_image(tmp_path / "a.tif", frame=2999).rgb.shape == (64, 64, 3)
    with pytest.raises(ImageError, match="has no page 3001; it has 3000"):
        read_image(tmp_path / "a.tif", frame=3001)


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tif", ".bmp"])
def test_what_is_written_is_what_the_header_says(suffix):
    image = np.zeros((7, 13, 3), np.uint8)
    data = cv2.imencode(suffix, image)[1].tobytes()
    assert read_header(data, "a").pages == 1


LARGE = """
import sys, numpy as np
from vfplan.images.read import read_image
image = read_image(sys.argv[1])
print(image.rgb.shape, int(image.rgb[5, 7, 0]))
"""


@pytest.mark.full
@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tif", ".bmp"])
def test_the_largest_slices_are_read(tmp_path, suffix):
    side = int(MOST_PIXELS**0.5)
    image = np.full((side, side, 3), 200, np.uint8)
    assert cv2.imwrite(str(tmp_path / f"a{suffix}"), image)
    del image
    words = [sys.executable, "-c", LARGE, tmp_path / f"a{suffix}"]
    done = subprocess.run(words, capture_output=True, text=True, cwd=tmp_path, check=True)
    assert done.stdout.strip() == f"({side}, {side}, 3) 200"


def deflated_dicom(path, size):
    pydicom = pytest.importorskip("pydicom")
    from pydicom.dataset import FileDataset, FileMetaDataset

    meta = FileMetaDataset()
    meta.TransferSyntaxUID = pydicom.uid.DeflatedExplicitVRLittleEndian
    meta.MediaStorageSOPClassUID = pydicom.uid.SecondaryCaptureImageStorage
    meta.MediaStorageSOPInstanceUID = "1.2.3"
    dataset = FileDataset(str(path), {}, file_meta=meta, preamble=bytes(128))
    dataset.Rows, dataset.Columns, dataset.SamplesPerPixel = 8, 8, 3
    dataset.BitsAllocated = dataset.BitsStored = 8
    dataset.HighBit, dataset.PixelRepresentation, dataset.PlanarConfiguration = 7, 0, 0
    dataset.PhotometricInterpretation = "RGB"
    dataset.PixelData = bytes(8 * 8 * 3)
    held = io.BytesIO()
    dataset.save_as(held, enforce_file_format=True)
    data = held.getvalue()
    start = 144 + int.from_bytes(data[140:144], "little")
    if size:
        inflated = zlib.decompress(data[start:], -zlib.MAX_WBITS)
        packer = zlib.compressobj(1, wbits=-zlib.MAX_WBITS)
        parts = [packer.compress(inflated)]
        parts += [packer.compress(bytes(1 << 22)) for _ in range(size >> 22)]
        data = data[:start] + b"".join(parts) + packer.flush()
    path.write_bytes(data)


def test_a_deflated_file_that_would_fill_memory_is_refused(tmp_path, monkeypatch):
    import vfplan.images.dicom

    deflated_dicom(tmp_path / "a.dcm", 0)
    assert read_image(tmp_path / "a.dcm").rgb.shape == (8, 8, 3)
    monkeypatch.setattr(vfplan.images.dicom, "MOST_INFLATED", 1 << 24)
    deflated_dicom(tmp_path / "b.dcm", 1 << 26)
    with pytest.raises(ImageError, match="holds more than 16777216 deflated bytes"):
        read_image(tmp_path / "b.dcm")
