"""Write docs/formats.md: what each format of input says of itself, and what vfplan makes of it.

    python docs/make_formats.py            write the page
    python docs/make_formats.py --check    change nothing, exit 1 when the page is not current

The rows stand here; what they name is held against the sources: endings, units, spaces, options.
"""

from __future__ import annotations

import sys
from pathlib import Path

from vfplan.bundle.exporting import FORMS
from vfplan.bundle.importing import SIGNS_OF_SPACE, SUFFIXES
from vfplan.surface.volumes import METRES

PAGE = Path(__file__).resolve().parent / "formats.md"
HEAD = """# Formats

<!-- Made by docs/make_formats.py. Do not edit. -->
"""
WORDS = {
    "read": "What vfplan takes from a file, or ignores.",
    "obeyed": "What vfplan believes because the file says it. No option is needed.",
    "asked":
        "What the file leaves open. If an option is *needed*, the command stops without it. "
        "Otherwise it uses the default that the cell names. It may print a *doubt* (`warning:`), "
        "which you must answer before `vfplan sign`, or a *note*, which only informs "
        "([glossary](glossary.md#findings-and-approval)).",
    "refused": "What stops the command. A file that is cut short or damaged is always refused.",
    "tried with": "The software or data behind our tests.",
    "table":
        "A text in UTF-8, or in UTF-16 with a byte order mark. The first line names the columns, "
        "which commas, semicolons or tabs separate. The decimal sign is a point or a comma. A line "
        "that begins with `#` is a remark.",
    "unit":
        "Behind the name of a length: `x_mm`, `x [mm]` or `x (mm)`. Times are in s.",
    "`--frame`":
        "For slices the number of a page, frame or slice, from 1. For sessions and `vfplan import` "
        "a coordinate system ([glossary](glossary.md#from-the-image-to-the-robot)).",
}  # fmt: skip
COLUMNS = ("format", "read", "obeyed", "asked", "refused", "tried with")
SPACES = " or ".join(f"`SPACE={name}`" for name in SIGNS_OF_SPACE)
UNITS = ", ".join(METRES)
SLICES = "two slices at one place; a missing slice, unless `--max-spacing` allows the gap"
NAMED_IMAGES = (
    "the images that it names: a DICOM slice must be one of them; another picture is a doubt"
)
STROKE = "`--stroke`, needed if the file holds several lines, or anything beside one line"
STRUCTURE = "`--structure`, needed if there are several"
SPLINE = (
    "`--curve-type`: a spline, with a doubt if straight lines differ by more than a tenth of "
    "`--contact-radius`"
)
PIXELS = (
    "`--pixels`, if the orientation turns the picture: `as-shown`, with a note; with markers or "
    "`--curve` also a doubt"
)
MIXED = "decimal commas and points in one table"
VARIANTS = "120 variants of one table: separator, decimal sign, encoding"
BLACK = "transparent parts turn black; a resolution in dpi is ignored"
IMPORTED = ", ".join(f"`{suffix}`" for suffix in SUFFIXES)
SURFACES = f"""`vfplan import` reads {IMPORTED}, and `vfplan surface` reads the
other formats. Of a surface, closed ends and a gap that `--max-spacing` allows are doubts.

"""
TABLES = {
    "Slices": [
        ("PNG, JPEG",
         f"8 bits a sample, PNG also 16; palettes; {BLACK}; bytes after the end of the picture are "
         "ignored, with a note",
         "EXIF's orientation", PIXELS, "animations", "Pillow, OpenCV"),
        ("TIFF",
         f"8 and 16 bits a sample, strips and tiles; {BLACK}; an extra channel whose meaning the "
         "file does not give is ignored, with a doubt",
         "orientation; an alpha channel that the file declares",
         f"`--frame N`, the page, needed if there are several; {PIXELS}",
         "samples of other kinds: signed, of 32 bits, floating point; 16-bit CMYK; 16-bit "
         "colours in separate planes",
         "tifffile, Pillow, OpenCV"),
        ("BMP", f"8, 24 and 32 bits a pixel; {BLACK}", "alpha, unless it is 0 everywhere", "",
         "a picture without pixels", "Pillow, OpenCV"),
        ("DICOM",
         "colour, grey; overlay planes are ignored, with a note. ImagerPixelSpacing is the size of "
         "a pixel at the detector: it is read with `--imager-spacing` alone",
         "PixelSpacing, position and orientation, also of each frame of an enhanced (multi-frame) "
         "file; window centre and width",
         "`--frame N`, needed if there are several frames; pixels that are square by their size "
         "and "
         "not by PixelAspectRatio: taken as square, a doubt",
         "PixelAspectRatio other than 1:1 without PixelSpacing, `--imager-spacing` or "
         "`--pixel-spacing`",
         "pydicom"),
        ("NRRD, NIfTI", "one slice of a grey volume, across its third (stored) axis",
         "origin, patient axes, units; mm if it names none",
         "`--frame N`, the slice, needed if there are several; `--curve`, needed for every grey "
         "slice, also of the formats above, because it shows no pen",
         "several volumes in a file; no place in the patient; sform and qform that differ; voxels "
         "that are not finite",
         "pynrrd, nibabel"),
    ],
    "Curves as vectors, for `--curve`": [
        ("Slicer `.mrk.json`, `.fcsv`",
         "`.mrk.json`: one Curve or ClosedCurve; `.fcsv`: points in order; points that are not "
         "*defined* are left out", "LPS or RAS, units", SPLINE,
         "several curves; a `.fcsv` without CoordinateSystem; a curve more than 1 mm off the "
         "slice's plane", "curves of VTK's vtkCardinalSpline"),
        ("ImageJ `.roi`", "polyline, freeline; polygon, freehand, traced",
         "areas count from a pixel's corner",
         "`--curve-origin`, needed for lines of a format before 228; of lines of format 228: "
         "`centre`, a note",
         "straight lines, rectangles, ovals, points, fitted splines, composite selections",
         "roifile"),
        ("ImageJ's tables `X,Y`", "points in order", "a unit of the columns",
         "`--curve-origin`, needed",
         "other columns; a table with a unit, if the size of a pixel is not known",
         "tables as ImageJ 1.54 writes them"),
        ("tables `u_px,v_px`", "points in order", "", "", f"other names of columns; {MIXED}",
         VARIANTS),
        ("DICOM presentation state",
         "POLYLINE; INTERPOLATED: a spline is laid through the points, a note; other shapes are "
         "not "
         "read",
         NAMED_IMAGES, STROKE, "units other than PIXEL; a file without a line", "pydicom"),
        ("DICOM SR (TID 1500)", "SCOORD and SCOORD3D lines, open and closed",
         NAMED_IMAGES, STROKE, "a file without a line", "pydicom"),
        ("RTSTRUCT", "OPEN_PLANAR and closed contours",
         "the images that it names: your slice must be one of them", STROKE,
         "a file without a line; a slice that is not DICOM", "pydicom"),
    ],
    "Markers, poses, sessions": [
        ("tables of markers",
         "one table `label,u_px,v_px,x,y,z`, or two that `label` joins; empty cells at the end "
         "of a "
         "line are ignored",
         "the units m, cm and mm",
         "if `x,y,z` have no unit: m or mm, guessed from how far the markers spread, a note; a "
         "doubt if the size of a pixel is not known",
         MIXED, VARIANTS),
        ("tables of poses and sessions",
         "sessions (recorded movements) `t,x,y,z`; poses `t,x,y,z,qw,qx,qy,qz`",
         "", "`--units`: m", f"units in the header that contradict `--units`; {MIXED}", VARIANTS),
        ("ImageJ's tables `X,Y`", "the Results table, the list of a multi-point",
         "a unit of the columns; `Label` or `Name`; X,Y count from the corner of a pixel if "
         "`Area` exceeds one pixel in each row, else from its centre",
         "X,Y without a unit are pixels, a doubt; points without `Label` or `Name` are numbered 1, "
         "2, … in the order of the rows, a note",
         "a table with a unit, if neither the slice nor `--pixel-spacing` gives the size of a "
         "pixel",
         "tables as ImageJ 1.54 writes them"),
        ("Slicer `.mrk.json`, `.fcsv`", "points (Fiducial)",
         "LPS or RAS, units; status: points that are not *defined* are left out", "",
         "a `.mrk.json` of another schema than version 1; a `.fcsv` with other columns, or without "
         "CoordinateSystem",
         "files of Slicer 3, 4 and 5"),
        ("HDF5, `.npz`",
         "sessions: T times `time` [s], shape (T,), and as many positions of the tool tip, `hip` "
         "([glossary](glossary.md#at-run-time)), shape (T, 3)",
         "", "`--units`: m; `--frame`: `robot_base`",
         "attributes (`.npz`: arrays) `units` or `frame` that contradict the options",
         "h5py, NumPy"),
        ("MCAP, ROS 1 and ROS 2 bags",
         "sessions: what `vfplan live --mcap` wrote; topics with poses, transforms, points or "
         "Franka states",
         "time of each message",
         "`--units`: m; `--topic`, needed if several hold positions; `--field`, needed if a "
         "message has several; `--sender`, `--frame` or `--child-frame`, needed if several send "
         "on one topic. Messages of another frame are taken as `robot_base`, a note",
         "topics without a position", "rosbags, mcap"),
    ],
    "Surfaces and clouds": [
        ("STL, PLY, OBJ", "triangles; PLY and OBJ also points",
         f"{SPACES}, and unit and frame that `vfplan export` wrote, in header or comment",
         "`--units`, needed; `--frame`: `robot_base` unless the file names a frame; the command "
         "prints it",
         "a unit or frame other than the option's; other values of `SPACE`; faces that are not "
         "triangles",
         "trimesh; headers as 3D Slicer writes them"),
        ("tables, NPY", "points: columns `x,y,z`, or an array of shape (N, 3)", "",
         "`--units`, needed; `--frame`: as above",
         "units in the header that contradict `--units`", "NumPy"),
        ("NRRD", "label maps, segments",
         f"`space`: patient axes in any order; units {UNITS}; mm if it names none", STRUCTURE,
         "any other `space` or unit; a missing `space origin` or `space directions`", "pynrrd, "
         "SimpleITK"),
        ("NIfTI", "label maps", "sform, qform, units; mm if it names none", STRUCTURE,
         "neither sform nor qform; both, if they differ", "nibabel, SimpleITK"),
        ("RTSTRUCT", "closed contours; open contours and single points are left out, with a doubt",
         "names and numbers of the structures", STRUCTURE, f"the same contour twice; {SLICES}",
         "pydicom"),
        ("DICOM SEG", "BINARY, FRACTIONAL, LABELMAP (segment 0 is the background)",
         "position of each frame", STRUCTURE, SLICES, "pydicom"),
        ("Slicer `.mrk.json`", "closed curves, in one file or several", "LPS or RAS, units",
         SPLINE, f"open curves; the same curve twice; {SLICES}", "`samples/make_bone.py`"),
        ("folder of DICOM slices", "a closed curve drawn on each slice, with a pen of "
         "`--colour`; what `vfplan extract` asks "
         "of a slice is a doubt, and so are slices without a curve before or after the others",
         "position and orientation of each slice", "", f"open curves; the same curve twice; "
         f"{SLICES}",
         "pydicom"),
    ],
}  # fmt: skip


OWN_FRAME = "the [bundle's](glossary.md#the-fixture)"
PATIENT_OR_OWN = "LPS if the registration knows the patient's axes, else the bundle's"
STUDY = "LPS, of the study of the slice in `--study`, which is needed"
# Ending -> what it holds, unit and frame of what `vfplan export` writes.
WRITTEN = {
    ".rtstruct.dcm": ("strokes, as contours", "mm", STUDY),
    ".seg.dcm": ("the inside of a closed mesh, as voxels", "mm", STUDY),
    ".ply": ("points, triangles", "m; px before the registration", OWN_FRAME),
    ".stl": ("triangles", "mm", PATIENT_OR_OWN),
    ".csv": ("points; strokes and deviations, if there are any", "m; px before the "
    "registration", OWN_FRAME),
    ".mrk.json": (
        "strokes, after the registration", "mm",
        f"{PATIENT_OR_OWN}; the file says LPS all the same, and the command warns"),
    ".dxf": ("lines and arcs, after the registration", "mm, unsaid in the file", OWN_FRAME),
}  # fmt: skip


def main(arguments: list[str]) -> int:
    """Write the page, or only say whether it is current."""
    text = HEAD + "\n| word | meaning |\n|---|---|\n"
    text += "".join(f"| {word} | {meaning} |\n" for word, meaning in WORDS.items())
    for title, rows in TABLES.items():
        text += f"\n## {title}\n\n"
        if title == "Surfaces and clouds":
            text += SURFACES
        text += f"| {' | '.join(COLUMNS)} |\n|{'---|' * len(COLUMNS)}\n"
        text += "".join(f"| {' | '.join(row)} |\n" for row in rows)
    text += "\n## Written\n\n`vfplan export` writes:\n\n"
    text += f"| format | holds | unit | frame |\n{'|---' * 4}|\n"
    text += "".join(f"| `{suffix}` | {' | '.join(WRITTEN[suffix])} |\n" for suffix in FORMS)
    if "--check" in arguments:
        return int(PAGE.read_text() != text)
    PAGE.write_text(text)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
