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

Reference.
"""
WORDS = {
    "read": "What vfplan takes from a file, and what it ignores.",
    "obeyed": "What the file says of itself. No option is needed.",
    "asked":
        "What the file leaves open. If an option is *needed*, the command stops without it. For "
        "any other choice the line names a default, and what the command says of it: a *doubt* "
        "wants an answer before `vfplan sign`, a *note* only informs "
        "([glossary](glossary.md#findings-and-approval)).",
    "refused": "What stops the command.",
    "tried with": "The software or data behind our tests.",
    "table":
        "A text in UTF-8 or UTF-16. Its first line names the columns, which commas, semicolons or "
        "tabs separate. Decimals may have a point or a comma, `#` begins a remark, and a unit "
        "stands behind a name: `x_mm` or `x [mm]`.",
}  # fmt: skip
COLUMNS = ("format", "read", "obeyed", "asked", "refused", "tried with")
SPACES = " or ".join(f"`SPACE={name}`" for name in SIGNS_OF_SPACE)
UNITS = ", ".join(METRES)
SLICES = "slice that is there twice; a missing slice, unless `--max-spacing` allows the gap"
NAMED_IMAGES = "the images that it names: your slice must be one of them"
STROKE = "`--stroke`, needed if there are several lines"
STRUCTURE = "`--structure`, needed if there are several"
SPLINE = (
    "`--curve-type`: a spline, with a doubt if straight lines differ by more than a tenth of the "
    "[contact radius](glossary.md#the-fixture)"
)
PIXELS = "`--pixels`, if EXIF turns the picture: markers and curve count pixels as shown, a doubt"
MIXED = "decimal commas and points in one table"
VARIANTS = "one table in 120 spellings: separators, decimals, encodings"
IMPORTED = ", ".join(f"`{suffix}`" for suffix in SUFFIXES)
SURFACES = f"""`vfplan import` reads {IMPORTED}, and `vfplan surface` reads the
other formats. For `import`, `--frame` is the coordinate system of the numbers: `robot_base` or
`patient_lps`.

"""
TABLES = {
    "Slices": [
        ("PNG, JPEG",
         "8 bits, PNG also 16; palettes; transparent pixels are laid over black; a resolution in "
         "dpi is ignored; bytes after the end of the picture are ignored, with a note",
         "EXIF's orientation", PIXELS,
         "animations; files that are cut short", "Pillow, OpenCV"),
        ("TIFF",
         "8 and 16 bits, strips and tiles; a resolution in dpi is ignored; a further channel of "
         "unknown meaning is ignored, with a doubt",
         "orientation; an alpha channel that the file declares",
         f"`--frame N`, the page, needed if there are several; {PIXELS}",
         "pixels that are not whole numbers; 16-bit CMYK; 16-bit colours in separate planes",
         "tifffile, Pillow, OpenCV"),
        ("BMP", "24 and 32 bits; a resolution is ignored", "an alpha channel that is not empty", "",
         "a picture without pixels", "Pillow, OpenCV"),
        ("DICOM",
         "colour, grey; overlay planes are ignored, with a note; ImagerPixelSpacing, which is the "
         "detector's, only with `--imager-spacing`",
         "PixelSpacing, position and orientation, also of each frame of an enhanced (multi-frame) "
         "file; window centre and width",
         "`--frame N`, needed if there are several frames",
         "PixelAspectRatio other than 1:1, if neither the file nor `--pixel-spacing` gives the "
         "size of a pixel",
         "pydicom"),
        ("NRRD, NIfTI", "grey volumes, of which a slice perpendicular to the third axis",
         "origin, patient axes, units (without any: mm)",
         "`--frame N`, the slice, needed if there are several; `--curve`, needed because a grey "
         "slice shows no pen",
         "several volumes in a file; sform and qform that differ; voxels that are not finite",
         "pynrrd, nibabel"),
    ],
    "Curves as vectors": [
        ("Slicer `.mrk.json`, `.fcsv`",
         "`.mrk.json`: one Curve or ClosedCurve; `.fcsv`: points in order", "LPS or RAS, units",
         SPLINE, "several curves; a curve off the slice's plane", "VTK's vtkCardinalSpline"),
        ("ImageJ `.roi`, tables `X,Y`", "lines and areas",
         "`.roi`: whether it counts from a pixel's centre or corner, by its version; table: a unit "
         "in the header",
         "`--curve-origin`, needed for tables, and for lines of a `.roi` from before ImageJ 1.52u",
         "fitted splines, composite selections; tables with other columns",
         "roifile"),
        ("tables `u_px,v_px`", "points in order", "the names of the columns", "", MIXED, VARIANTS),
        ("DICOM presentation state",
         "POLYLINE; INTERPOLATED as a spline, with a note: compare it with the original drawing",
         NAMED_IMAGES, STROKE, "units other than PIXEL", "pydicom"),
        ("DICOM SR (TID 1500)", "SCOORD and SCOORD3D lines, open and closed",
         NAMED_IMAGES, STROKE, "ellipses, points", "pydicom"),
        ("RTSTRUCT", "OPEN_PLANAR and closed contours", NAMED_IMAGES, STROKE,
         "contours of the type POINT", "pydicom"),
    ],
    "Markers, poses, sessions": [
        ("tables of markers",
         "`label,u_px,v_px` and `label,x,y,z`, in one table or two; empty cells at the end",
         "units in the header",
         "the unit of `x,y,z` without one: m or mm, by how far the markers spread, a note (a doubt "
         "if no pixel size is known)",
         MIXED, VARIANTS),
        ("tables of poses and sessions",
         "sessions (recorded movements) `t,x,y,z`; poses `t,x,y,z,qw,qx,qy,qz`; in `--units` "
         "(m if not given)",
         "", "", f"units in the header that contradict `--units`; {MIXED}", VARIANTS),
        ("ImageJ's tables `X,Y`", "a table of results, a list of points",
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
        ("HDF5, `.npz`",
         "sessions: T times `time` [s], shape (T,), and positions of the tool tip `hip`, shape "
         "(T, 3), in `--units` (m if not given) and `--frame` (`robot_base` if not given)",
         "", "",
         "attributes (`.npz`: arrays) `units` or `frame` that contradict the options",
         "h5py, NumPy"),
        ("MCAP, ROS 1 and ROS 2 bags",
         "sessions: what `vfplan live --mcap` wrote; topics with poses, transforms, points or "
         "Franka states; in `--units` (m if not given)",
         "time of each message",
         "`--topic`, needed if several hold positions; `--field`, needed if a message has several; "
         "`--sender` or `--frame FRAME_ID`, needed if several send on one topic",
         "topics with only joint angles, forces or quaternions", "rosbags, mcap"),
    ],
    "Surfaces and clouds": [
        ("STL, PLY, OBJ", "triangles; PLY and OBJ also points",
         f"{SPACES}, and unit and frame that `vfplan export` wrote, in header or comment",
         "`--units`, needed; `--frame`, which is `robot_base` if neither it nor the file names "
         "one: the command prints the frame",
         "a unit or frame other than the option's; other values of `SPACE`; faces that are not "
         "triangles",
         "trimesh; headers as 3D Slicer writes them"),
        ("tables, NPY", "points: columns `x,y,z`, or an array of shape (N, 3)", "",
         "`--units`, needed; `--frame`: as above",
         "units in the header that contradict `--units`", "NumPy"),
        ("NRRD", "label maps, segments",
         f"`space`: patient axes in any order; units {UNITS} (without any: mm)", STRUCTURE,
         "other axes and units; no `space origin` or no `space directions`", "pynrrd, SimpleITK"),
        ("NIfTI", "label maps", "sform, qform, units (without any: mm)", STRUCTURE,
         "sform and qform that differ", "nibabel, SimpleITK"),
        ("RTSTRUCT", "closed contours; open or broken contours are left out, with a doubt",
         "names and numbers of the structures", STRUCTURE, f"a contour or {SLICES}", "pydicom"),
        ("DICOM SEG", "BINARY, FRACTIONAL, LABELMAP (segment 0 is the background)",
         "position of each frame", STRUCTURE, f"a {SLICES}", "pydicom"),
        ("Slicer `.mrk.json`", "closed curves, in one file or several", "LPS or RAS, units",
         SPLINE, f"open curves; a curve or {SLICES}", "`samples/make_bone.py`"),
        ("folder of DICOM slices", "a closed curve drawn on each slice, with a pen of `--colour`",
         "position and orientation of each slice", "", f"open curves; a curve or {SLICES}",
         "pydicom"),
    ],
}  # fmt: skip


OWN_FRAME = "the [bundle's](glossary.md#the-fixture)"
PATIENT_OR_OWN = "LPS if the registration knows the patient's axes, otherwise the bundle's"
# Ending -> what it holds, unit and frame of what `vfplan export` writes.
WRITTEN = {
    ".rtstruct.dcm": ("strokes, as contours", "mm", "LPS, of the study that `--study` names"),
    ".seg.dcm": ("the inside of a closed mesh", "mm", "LPS, of the study that `--study` names"),
    ".ply": ("points, triangles", "m; px before the registration", OWN_FRAME),
    ".stl": ("triangles", "mm", PATIENT_OR_OWN),
    ".csv": ("points, their stroke and deviation", "m; px before the registration", OWN_FRAME),
    ".mrk.json": ("strokes", "mm", f"{PATIENT_OR_OWN}, though the file says LPS"),
    ".dxf": ("lines and arcs", "mm", OWN_FRAME),
}


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
