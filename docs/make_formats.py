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

Reference. vfplan obeys what a file says of itself, reports what it ignores, or refuses the file.
*Asked*: what the file leaves open. Give the option, or answer the *doubt* before `vfplan sign`. A
*note* only informs ([glossary](glossary.md#findings-and-approval)).
*Tried with*: the software or data behind our tests.
"""
COLUMNS = ("format", "read", "obeyed", "asked", "refused", "tried with")
SPACES = " or ".join(f"`SPACE={name}`" for name in SIGNS_OF_SPACE)
UNITS = ", ".join(METRES)
SLICES = "slice that is there twice; a missing slice, unless `--max-spacing` allows the gap"
NAMED_IMAGES = "the images that it names: your slice must be one of them"
IMPORTED = ", ".join(f"`{suffix}`" for suffix in SUFFIXES)
SURFACES = f"""`vfplan import` reads {IMPORTED}, and `vfplan surface` reads the
other formats.

"""
TABLES = {
    "Slices": [
        ("PNG, JPEG",
         "8 bits, PNG also 16; palettes; transparent pixels are laid over black; bytes after the "
         "end of the picture are ignored, with a note",
         "EXIF's orientation",
         "`--pixels`: whether markers and curve are in pixels before or after EXIF's rotation",
         "animations; files that are cut short", "Pillow, OpenCV"),
        ("TIFF",
         "8 and 16 bits, strips and tiles, one page by `--frame`; a further channel of unknown "
         "meaning is ignored, with a doubt",
         "orientation; an alpha channel that the file declares", "`--pixels`",
         "pixels that are not whole numbers; 16-bit CMYK; 16-bit colours in separate planes",
         "tifffile, Pillow, OpenCV"),
        ("BMP", "24 and 32 bits", "an alpha channel that is not empty", "",
         "a picture without pixels", "Pillow, OpenCV"),
        ("DICOM", "colour, grey, one frame by `--frame`; overlay planes are ignored, with a note",
         "PixelSpacing, position and orientation, also of each frame of an enhanced (multi-frame) "
         "file; window centre and width",
         "`--imager-spacing`, if the file has only ImagerPixelSpacing",
         "PixelAspectRatio other than 1:1, if neither the file nor `--pixel-spacing` gives the "
         "size of a pixel",
         "pydicom"),
        ("NRRD, NIfTI", "grey volumes, one slice perpendicular to the third axis by `--frame`",
         "origin, patient axes, units (without any: mm)", "",
         "several volumes in a file; sform and qform that differ; voxels that are not finite",
         "pynrrd, nibabel"),
    ],
    "Curves as vectors": [
        ("Slicer `.mrk.json`, `.fcsv`",
         "`.mrk.json`: one Curve or ClosedCurve; `.fcsv`: points in order", "LPS or RAS, units",
         "`--curve-type`, if spline and straight lines differ by more than a tenth of the "
         "[contact radius](glossary.md#the-fixture)",
         "several curves; a curve off the slice's plane", "VTK's vtkCardinalSpline"),
        ("ImageJ `.roi`, CSV `X,Y`", "lines and areas",
         "`.roi`: pixel centre or corner, by its version; CSV: a unit in the header",
         "`--curve-origin` for CSV, and for lines of a `.roi` from before ImageJ 1.52u",
         "fitted splines, composite selections; tables with other columns",
         "roifile"),
        ("CSV `u_px,v_px`", "any separator, decimal comma, UTF-8 or UTF-16, comments",
         "the names of the columns", "", "decimal commas and points in one table",
         "one table in 120 variants"),
        ("DICOM presentation state",
         "POLYLINE; INTERPOLATED as a spline, with a note: compare it with the original drawing",
         NAMED_IMAGES, "`--stroke`, if there are several lines",
         "units other than PIXEL", "pydicom"),
        ("DICOM SR (TID 1500)", "SCOORD and SCOORD3D lines, open and closed",
         NAMED_IMAGES, "`--stroke`", "ellipses, points", "pydicom"),
        ("RTSTRUCT", "OPEN_PLANAR and closed contours", NAMED_IMAGES, "`--stroke`",
         "contours of the type POINT", "pydicom"),
    ],
    "Markers, poses, sessions": [
        ("CSV",
         "markers `label,u_px,v_px` and `label,x_m,y_m,z_m` (or `x,y,z`); sessions (recorded "
         "movements) `t,x,y,z`; poses "
         "`t,x,y,z,qw,qx,qy,qz`; any separator, decimal comma, UTF-8 or UTF-16, comments, empty "
         "cells at the end",
         "units in the header; poses and sessions without: `--units`, or m",
         "the unit of markers: vfplan guesses m or mm from how far they spread, with a note (a "
         "doubt if no pixel size is known)",
         "decimal commas and points in one table", "one table in 120 variants"),
        ("ImageJ's `X,Y`", "a table of results, a list of points",
         "a unit in the header; the number of a point, which becomes its label; if "
         "`Area` exceeds one pixel in each row: X,Y count from the corner of a pixel",
         "whether X,Y without a unit are pixels: a doubt",
         "a table with a unit, if neither the slice nor `--pixel-spacing` gives the size of a "
         "pixel",
         "tables as ImageJ 1.54 writes them"),
        ("Slicer `.mrk.json`, `.fcsv`", "points (Fiducial)",
         "LPS or RAS, units; status: points that are not *defined* are left out", "",
         "a `.mrk.json` of another schema than version 1; a `.fcsv` with other columns",
         "files of Slicer 3, 4 and 5"),
        ("HDF5, `.npz`", "sessions: `time` (T,) [s] and `hip` (T, 3), the tool tip's positions",
         "", "`--units` (default m), `--frame` (the coordinate system)",
         "attributes (`.npz`: arrays) `units` or `frame` that contradict the options",
         "h5py, NumPy"),
        ("MCAP, ROS 1 and ROS 2 bags",
         "sessions: what `vfplan live --mcap` wrote; topics with poses, transforms, points or "
         "Franka states", "`frame_id` and time of each message",
         "`--topic`, `--field`, `--units`; if a topic has several: `--sender`, `--frame` (the "
         "`frame_id`)",
         "topics with only joint angles, forces or quaternions", "rosbags, mcap"),
    ],
    "Surfaces and clouds": [
        ("STL, PLY, OBJ", "triangles; PLY also points", f"{SPACES} in header or comment",
         "`--units`; `--frame` (the coordinate system), if the file has no `SPACE`",
         "other values of `SPACE`; `--frame robot_base`, if the file has a `SPACE`; faces that are "
         "not triangles",
         "trimesh; headers as 3D Slicer writes them"),
        ("CSV, NPY", "points", "units in the header", "`--units`, `--frame`",
         "columns with different units", "NumPy"),
        ("NRRD", "label maps, segments",
         f"`space`: patient axes in any order; units {UNITS} (without any: mm)",
         "`--structure`",
         "other axes and units; no `space origin` or no `space directions`", "pynrrd, SimpleITK"),
        ("NIfTI", "label maps", "sform, qform, units (without any: mm)", "`--structure`",
         "sform and qform that differ", "nibabel, SimpleITK"),
        ("RTSTRUCT", "closed contours; open or broken contours are left out, with a doubt",
         "names and numbers of the structures", "`--structure`", f"a contour or {SLICES}",
         "pydicom"),
        ("DICOM SEG", "BINARY, FRACTIONAL, LABELMAP (segment 0 is the background)",
         "position of each frame", "`--structure`", f"a {SLICES}", "pydicom"),
        ("Slicer `.mrk.json`", "closed curves, in one file or several", "LPS or RAS, units",
         "`--curve-type`, if spline and straight lines differ", f"open curves; a curve or {SLICES}",
         "`samples/make_bone.py`"),
        ("folder of DICOM slices", "a closed curve drawn on each slice, with a pen of `--colour`",
         "position and orientation of each slice", "", f"open curves; a curve or {SLICES}",
         "pydicom"),
    ],
}  # fmt: skip


OWN_FRAME = "the [bundle's](glossary.md#the-fixture)"
PATIENT_OR_OWN = "LPS if the registration knows the patient's axes, otherwise the bundle's"
# Ending -> unit and frame of what `vfplan export` writes.
WRITTEN = {
    ".rtstruct.dcm": ("mm", "LPS, of the study that `--study` names"),
    ".seg.dcm": ("mm", "LPS, of the study that `--study` names"),
    ".ply": ("m; px before the registration", OWN_FRAME),
    ".stl": ("mm", PATIENT_OR_OWN),
    ".csv": ("m; px before the registration", OWN_FRAME),
    ".mrk.json": ("mm", f"{PATIENT_OR_OWN}, though the file says LPS"),
    ".dxf": ("mm", OWN_FRAME),
}


def main(arguments: list[str]) -> int:
    """Write the page, or only say whether it is current."""
    text = HEAD
    for title, rows in TABLES.items():
        text += f"\n## {title}\n\n"
        if title == "Surfaces and clouds":
            text += SURFACES
        text += f"| {' | '.join(COLUMNS)} |\n|{'---|' * len(COLUMNS)}\n"
        text += "".join(f"| {' | '.join(row)} |\n" for row in rows)
    text += f"\n## Written\n\n`vfplan export` writes:\n\n| format | unit | frame |\n{'|---' * 3}|\n"
    text += "".join(f"| `{suffix}` | {' | '.join(WRITTEN[suffix])} |\n" for suffix in FORMS)
    if "--check" in arguments:
        return int(PAGE.read_text() != text)
    PAGE.write_text(text)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
