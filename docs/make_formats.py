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

Reference. What a file says of itself is obeyed or refused. What it does not say is asked: by an
option, or by a doubt that wants an answer before `vfplan sign`.
"""
COLUMNS = ("format", "read", "obeyed", "asked", "refused", "tried with")
SPACES = " or ".join(f"`SPACE={name}`" for name in SIGNS_OF_SPACE)
UNITS = ", ".join(METRES)
TABLES = {
    "Slices": [
        ("PNG, JPEG", "8 bits, PNG also 16; palette, alpha over black",
         "EXIF's orientation; the end of the picture, data behind it are left out with a note",
         "`--pixels`, if EXIF turns the picture and other files count its pixels",
         "animations; what is cut short", "Pillow, OpenCV"),
        ("TIFF", "8 and 16 bits, strips and tiles, one page by `--frame`",
         "orientation; alpha that says so",
         "`--pixels`; a sample beside the colours that says nothing is left out with a doubt",
         "floats; inks or separate planes of 16 bits", "tifffile, Pillow, OpenCV"),
        ("BMP", "24 and 32 bits", "an alpha mask that is used", "", "no size", "Pillow, OpenCV"),
        ("DICOM", "colour, grey, one frame by `--frame`",
         "PixelSpacing, position and orientation, also of each frame of an enhanced file; windows",
         "`--imager-spacing`; overlay planes are left out with a note",
         "pixels that are not square and have no size, without `--pixel-spacing`", "pydicom"),
    ],
    "Curves as vectors": [
        ("Slicer `.mrk.json`, `.fcsv`", "one Curve or ClosedCurve", "LPS or RAS, units",
         "`--curve-type`, if a spline and lines differ by a tenth of the contact radius",
         "several curves; a curve off the slice's plane", "VTK's vtkCardinalSpline"),
        ("ImageJ `.roi`, CSV `X,Y`", "lines and areas",
         "how the format counts; a unit in the header",
         "`--curve-origin`", "spline fits, composites; tables of other columns", "roifile"),
        ("CSV `u_px,v_px`", "any separator, decimal comma, UTF-8 or UTF-16, remarks", "the header",
         "", "two decimal marks", "60 forms of one table"),
        ("DICOM presentation state", "POLYLINE, INTERPOLATED", "the images that it names",
         "`--stroke`, if there are several; how points of INTERPOLATED are joined", "other units",
         "pydicom"),
        ("DICOM SR (TID 1500)", "SCOORD and SCOORD3D lines, open and closed",
         "the images that it names", "`--stroke`", "ellipses, points", "pydicom"),
        ("RTSTRUCT", "OPEN_PLANAR and closed contours", "the images that it names", "`--stroke`",
         "POINT", "pydicom"),
    ],
    "Markers, poses, sessions": [
        ("CSV", "any separator, decimal comma, UTF-8 or UTF-16, remarks, blank ends",
         "units in the header", "x,y,z without a unit: concluded by size, with a note",
         "`X,Y` without Z, whose unit nobody says; two decimal marks", "60 forms of one table"),
        ("Slicer `.mrk.json`, `.fcsv`", "Fiducial", "LPS or RAS, units, status", "",
         "other schemas", "Slicer's formats 3, 4 and 5"),
    ],
    "Surfaces and clouds": [
        ("STL, PLY, OBJ", "triangles; PLY also points", f"{SPACES} in header or comment",
         "`--units`; `--frame`, if the file names no space",
         "another space; `--frame robot_base` beside a space; faces of four corners",
         "trimesh; headers as 3D Slicer writes them"),
        ("CSV, NPY", "points", "units in the header", "`--units`, `--frame`",
         "units that differ", "NumPy"),
        ("NRRD", "label maps, segments", f"spaces of the patient in any order; units {UNITS}",
         "`--structure`", "other spaces and units; a place that is missing", "pynrrd, SimpleITK"),
        ("NIfTI", "label maps", "sform, qform, units", "`--structure`", "two places that differ",
         "nibabel, SimpleITK"),
        ("RTSTRUCT, DICOM SEG", "closed contours; BINARY, FRACTIONAL, LABELMAP",
         "places of all frames; number 0 is background",
         "`--structure`; contours that are open or broken are left out with a doubt",
         "slices that are doubled or missing", "pydicom"),
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
    text += "STL and `.mrk.json` are in the patient's axes if the registration tells them.\n"
    text += f"`vfplan import` reads {', '.join(f'`{suffix}`' for suffix in SUFFIXES)}.\n"
    if "--check" in arguments:
        return int(PAGE.read_text() != text)
    PAGE.write_text(text)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
