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

Reference. vfplan obeys what a file says of itself, or refuses the file. If the file leaves
something open, vfplan asks: give an option, or answer a *doubt* before `vfplan sign`. A *note* only
informs ([glossary](glossary.md#findings-and-approval)). *Tried with* names what made or
checked the tests' files.
"""
COLUMNS = ("format", "read", "obeyed", "asked", "refused", "tried with")
SPACES = " or ".join(f"`SPACE={name}`" for name in SIGNS_OF_SPACE)
UNITS = ", ".join(METRES)
TABLES = {
    "Slices": [
        ("PNG, JPEG",
         "8 bits, PNG also 16; palettes; transparent pixels are laid over black; bytes after the "
         "end of the picture are ignored, with a note",
         "EXIF's orientation",
         "`--pixels`, if EXIF turns the picture and markers or curve are given in its pixels",
         "animations; files that are cut short", "Pillow, OpenCV"),
        ("TIFF", "8 and 16 bits, strips and tiles, one page by `--frame`",
         "orientation; an alpha channel that the file declares",
         "`--pixels`; if the file does not say what a further channel means, vfplan ignores this "
         "channel, with a doubt",
         "pixels that are not whole numbers; 16 bits as inks (CMYK) or in separate planes",
         "tifffile, Pillow, OpenCV"),
        ("BMP", "24 and 32 bits", "an alpha channel that is not empty", "",
         "a picture without pixels", "Pillow, OpenCV"),
        ("DICOM", "colour, grey, one frame by `--frame`; overlay planes are ignored, with a note",
         "PixelSpacing, position and orientation, also of each frame of an enhanced file; windows",
         "`--imager-spacing`",
         "pixels that are not square, if neither the file nor `--pixel-spacing` gives their size",
         "pydicom"),
    ],
    "Curves as vectors": [
        ("Slicer `.mrk.json`, `.fcsv`", "one Curve or ClosedCurve", "LPS or RAS, units",
         "`--curve-type`, if a spline through the points and straight lines between them differ by "
         "more than a tenth of the contact radius",
         "several curves; a curve off the slice's plane", "VTK's vtkCardinalSpline"),
        ("ImageJ `.roi`, CSV `X,Y`", "lines and areas",
         "whether this version of the format counts from the centre or the corner of a pixel; a "
         "unit in the header",
         "`--curve-origin`", "fitted splines, composite selections; tables with other columns",
         "roifile"),
        ("CSV `u_px,v_px`", "any separator, decimal comma, UTF-8 or UTF-16, comments", "the header",
         "", "decimal commas and points in one table", "60 forms of one table"),
        ("DICOM presentation state",
         "POLYLINE; INTERPOLATED as a spline, with a note to compare it with the drawing",
         "the images that it names", "`--stroke`, if there are several", "units other than PIXEL",
         "pydicom"),
        ("DICOM SR (TID 1500)", "SCOORD and SCOORD3D lines, open and closed",
         "the images that it names", "`--stroke`", "ellipses, points", "pydicom"),
        ("RTSTRUCT", "OPEN_PLANAR and closed contours", "the images that it names", "`--stroke`",
         "contours of the type POINT", "pydicom"),
    ],
    "Markers, poses, sessions": [
        ("CSV",
         "markers `label,u_px,v_px` and `label,x_m,y_m,z_m`; sessions `t,x,y,z`; poses "
         "`t,x,y,z,qw,qx,qy,qz`; any separator, decimal comma, UTF-8 or UTF-16, comments, empty "
         "cells at the end",
         "units in the header",
         "poses and sessions: `--units`, otherwise metres. For markers without a unit vfplan takes "
         "m or mm, whichever suits the distances between them, with a note",
         "decimal commas and points in one table", "60 forms of one table"),
        ("ImageJ's `X,Y`", "results, lists of points",
         "a unit in the header; the number of a point, as its label; X,Y of an area count from "
         "the corner of a pixel",
         "whether X,Y without a unit are pixels: a doubt", "units without `--pixel-spacing`",
         "tables as ImageJ 1.54 writes them"),
        ("Slicer `.mrk.json`, `.fcsv`", "points (Fiducial)",
         "LPS or RAS, units; status: points that are not *defined* are left out", "",
         "other versions of the format", "Slicer's formats 3, 4 and 5"),
        ("HDF5, `.npz`", "sessions: `time` (T,) and `hip` (T, 3)",
         "the attributes (`.npz`: arrays) `units` and `frame`", "`--units`, `--frame`",
         "those that differ from the options", "h5py, NumPy"),
        ("MCAP, ROS 1 and ROS 2 bags",
         "sessions: what `vfplan live --mcap` wrote; topics with poses, transforms, points or "
         "Franka states", "the frame and the time of each message",
         "`--topic`, `--field`, `--sender`, `--frame`, `--units`",
         "joint angles, forces, quaternions alone", "rosbags, mcap"),
    ],
    "Surfaces and clouds": [
        ("STL, PLY, OBJ", "triangles; PLY also points", f"{SPACES} in header or comment",
         "`--units`; `--frame`, if the file names no axes",
         "other axes; `--frame robot_base`, if the file names axes of the patient; faces that are "
         "not triangles",
         "trimesh; headers as 3D Slicer writes them"),
        ("CSV, NPY", "points", "units in the header", "`--units`, `--frame`",
         "columns with different units", "NumPy"),
        ("NRRD", "label maps, segments", f"patient axes in any order (`space`); units {UNITS}",
         "`--structure`", "other axes and units; no position in the patient", "pynrrd, SimpleITK"),
        ("NIfTI", "label maps", "sform, qform, units", "`--structure`",
         "sform and qform that differ", "nibabel, SimpleITK"),
        ("RTSTRUCT, DICOM SEG", "closed contours; BINARY, FRACTIONAL, LABELMAP",
         "position of each frame; number 0 is background",
         "`--structure`; contours that are open or broken are left out, with a doubt",
         "a slice that is missing or is there twice", "pydicom"),
    ],
}  # fmt: skip


def main(arguments: list[str]) -> int:
    """Write the page, or only say whether it is current."""
    text = HEAD
    for title, rows in TABLES.items():
        text += f"\n## {title}\n\n| {' | '.join(COLUMNS)} |\n|{'---|' * len(COLUMNS)}\n"
        text += "".join(f"| {' | '.join(row)} |\n" for row in rows)
    listed = ", ".join(f"`{suffix}`" for suffix in FORMS)
    text += f"\n## Written\n\n`vfplan export` writes {listed}. "
    text += "STL and `.mrk.json` are in the patient's axes if the registration knows them.\n"
    text += f"`vfplan import` reads {', '.join(f'`{suffix}`' for suffix in SUFFIXES)}.\n"
    if "--check" in arguments:
        return int(PAGE.read_text() != text)
    PAGE.write_text(text)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
