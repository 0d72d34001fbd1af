"""Hostile bundles, each sealed correctly: what the parser behind the seal must refuse.

The broken files of the conformance kit are the first of them. Those here are what the kit does not
have: `CASES` maps a name to a function and its words, which damages an open h5py.File of a sound
bundle. `files()` yields the whole corpus.
"""

from __future__ import annotations

import io

import bundles
import damage
import fuzz_bundle
import h5py
import hdf5_spans
import numpy as np

from vfplan.bundle import review_digest
from vfplan.bundle.content import to_content
from vfplan.bundle.write import completed, to_payload
from vfplan.conformance import kit, vectors


def sound() -> bytes:
    return to_payload(completed(to_content(bundles.whole())))


def changed(function, *words, swept=True) -> bytes:
    """A sound payload that `function` changed; what h5py deleted is gone unless told otherwise."""
    stream = io.BytesIO(sound())
    with h5py.File(stream, "r+", libver=("v108", "v110")) as file:
        function(file, *words)
    data = bytearray(stream.getvalue())
    if swept:
        for first, end in hdf5_spans.rests(bytes(data)):
            data[first:end] = bytes(end - first)
    return fuzz_bundle.repaired(bytes(data))


# --- What a case does to a file -----------------------------------------------------------------


def put(f, path, data, dtype=None, **options):
    """Replace a dataset by another with the same attributes."""
    attributes = dict(f[path].attrs)
    del f[path]
    new = f.create_dataset(path, data=data, dtype=dtype, **options)
    for name, value in attributes.items():
        text(new, name, value)


def zeros(f, options):
    put(f, "sigma", np.zeros(70), **options)


def text(where, name, value, strpad=h5py.h5t.STR_NULLPAD):
    """A fixed-length text attribute as the writer makes it."""
    if name in where.attrs:
        del where.attrs[name]
    raw = value.encode() if isinstance(value, str) else bytes(value)
    kind = h5py.h5t.C_S1.copy()
    kind.set_size(max(1, len(raw)))
    kind.set_cset(h5py.h5t.CSET_UTF8)
    kind.set_strpad(strpad)
    space = h5py.h5s.create(h5py.h5s.SCALAR)
    attribute = h5py.h5a.create(where.id, name.encode(), kind, space)
    attribute.write(np.array(raw, dtype=f"S{max(1, len(raw))}"), mtype=kind)


def text_at(f, path, name, value):
    text(f[path], name, value)


def attribute(f, path, name, value, dtype=None):
    """Another value of an attribute, as h5py writes it."""
    if name in f[path].attrs:
        del f[path].attrs[name]
    f[path].attrs.create(name, value, dtype=dtype)


def element(f, path, index, value):
    f[path][index] = value


def replaced(f, path, thing):
    """Another thing under a name, or nothing."""
    if path in f:
        del f[path]
    if thing is not None:
        f[path] = thing


def again(f, path, other):
    """A second link to another object."""
    replaced(f, path, f[other])


def group(f, *paths):
    for path in paths:
        f.create_group(path)


def dataset(f, path, shape, **options):
    """Another dataset that was never written."""
    del f[path]
    f.create_dataset(path, shape, "<f8", **options)


def virtual_dataset(f):
    layout = h5py.VirtualLayout((70,), "<f8")
    layout[:] = h5py.VirtualSource("/etc/passwd", "x", (70,))
    del f["sigma"]
    f.create_virtual_dataset("sigma", layout)


def unknown_filter(f):
    dcpl = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    dcpl.set_chunk((70,))
    dcpl.set_filter(32123, h5py.h5z.FLAG_OPTIONAL, (1, 2, 3))
    del f["sigma"]
    space = h5py.h5s.create_simple((70,))
    h5py.h5d.create(f.id, b"sigma", h5py.h5t.IEEE_F64LE, space, dcpl=dcpl)


def thousand_attributes(f):
    for i in range(1000):
        f["points"].attrs[f"a{i}"] = i


def references(f):
    put(f, "sigma", np.array([f.ref] * 70, dtype=h5py.ref_dtype))


def region_references(f):
    put(f, "sigma", np.array([f["points"].regionref[:3]] * 70, dtype=h5py.regionref_dtype))


def named_type(f):
    f["curve/kind"] = np.dtype("<f8")
    put(f, "sigma", np.zeros(70), dtype=f["curve/kind"])
    del f["curve/kind"]


def findings(f, *left_out, place=False, **change):
    """One open doubt, with what `change` puts in place of its values."""
    texts = {"code": "odd", "severity": "doubt", "text": "Odd.", "stage": "plan"} | change
    made = f.create_group("findings")
    for name in texts.keys() - set(left_out):
        made.create_dataset(name, data=np.array([texts[name].encode()]))
    if place:
        dataset = made.create_dataset("place_px", data=np.ones((1, 2)))
        text(dataset, "unit", "px")
        text(dataset, "frame", "image")


def review(f, **change):
    made = f.create_group("review")
    values = {"by": "A. Planner", "utc": "2026-01-02T03:04:05Z"}
    values |= {"digest": review_digest(bundles.whole())} | change
    for name, value in values.items():
        if value is not None:
            text(made, name, value)


def guide(f, *, radius=1e-3, ends="stop"):
    text(f, "must_understand", "/guidance")
    made = f.create_group("guidance")
    made.attrs.create("radius_m", radius, dtype="<f8")
    made.attrs.create("stiffness_n_per_m", 800.0, dtype="<f8")
    made.attrs.create("stroke", 1, dtype="<i4")
    if ends is not None:
        text(made, "ends", ends)


def pieces(f, *, bulges=(0.0, 0.5, 0.0, 1.0, 1.0), stroke=(0, 0, 0, 1, 1)):
    """Lines and arcs of the arc and the ring."""
    made = f.create_group("pieces")
    made.attrs.create("error_m", 1e-6, dtype="<f8")
    for name, values, dtype, frame in (
        ("vertices", f["points"][:5], "<f8", "robot_base"),
        ("bulges", bulges, "<f8", None),
        ("stroke", stroke, "<i4", None),
    ):
        if values is not None:
            new = made.create_dataset(name, data=np.array(values, dtype))
            text(new, "unit", "m" if frame else "1")
            if frame:
                text(new, "frame", frame)


def newer_minor(f, *more):
    """A later minor version with unknown optional parts, which is sound."""
    text(f, "version", "2.7")
    f["surprise"] = np.zeros(3)
    f["curve/more"] = np.zeros(3, "S3")
    text(f["points"], "colour", "red")
    f["points"].attrs["weight"] = np.arange(5)
    for path, thing in more:
        f[path] = thing


def with_words(function, **words):
    """A case that gives a function these words."""
    return (lambda f: function(f, **words),)


PASSWD = {"external": [("/etc/passwd", 0, 560)]}
NAMED = {"no": 0, "yes": 1}
SHARED, SETTINGS = "provenance", "provenance/setting_values"
# fmt: off
CASES = {
    # Storage that reaches out of the file, or claims what is not there.
    "external_raw_storage": with_words(dataset, path="sigma", shape=(70,), **PASSWD),
    "external_link": (replaced, "sigma", h5py.ExternalLink("/etc/passwd", "/points")),
    "soft_link_to_nowhere": (replaced, "curve/more", h5py.SoftLink("/nowhere")),
    "virtual_dataset": (virtual_dataset,),
    "shape_of_8_tib": (dataset, "points", (2**40, 3)),
    "more_points_than_are_stored": (dataset, "points", (4_000_000, 3)),
    "chunks_of_4_gib": with_words(
        dataset, path="points", shape=(70, 3), maxshape=(None, 3), chunks=(2**27, 3)),
    "chunks": (zeros, {"chunks": (70,)}),
    "deflate_bomb": with_words(
        put, path="points", data=np.zeros((4_000_000, 3)), compression="gzip", compression_opts=9),
    "unknown_filter": (unknown_filter,),
    # Links and objects.
    "cycle_to_the_root": (again, "curve", "/"),
    "cycle_in_a_group": (again, "curve/curve", "curve"),
    "dataset_where_a_group_should_be": (replaced, "image", np.zeros(3)),
    "ten_thousand_links": (group, *(f"curve/{i}" for i in range(10_000))),
    "long_name": (group, "n" * 60_000),
    "unknown_group": (group, "curve/surprise"),
    "unknown_attribute_of_the_root": (text_at, "/", "surprise", "boo"),
    # Attributes.
    "huge_attribute": (attribute, "/", "frame", np.zeros(60_000, "u1")),
    "dense_huge_attribute": (attribute, "points", "unit", np.zeros(20_000_000, "u1")),
    "thousand_attributes": (thousand_attributes,),
    "variable_length_text": (attribute, "/", "frame", "robot_base"),
    "text_array": (attribute, "/", "frame", np.array([b"robot_base"])),
    "empty_attribute": (attribute, "/", "frame", h5py.Empty("S10")),
    "text_with_c1_controls": (text_at, SHARED, "software", "vf\u0085plan"),
    "text_with_a_surrogate": (text_at, SHARED, "software", b"a\xed\xa0\x80b"),
    "number_for_text": (attribute, "/", "frame", 7),
    "text_for_a_number": (text_at, "rendering", "band_m", "1e-5"),
    # Types.
    "float32": (zeros, {"dtype": "<f4"}),
    "compound": (put, "sigma", np.zeros(70, [("a", "<f4"), ("b", "<i4")])),
    "enum": (put, "curve/bridged", np.zeros(70, "u1"), h5py.enum_dtype(NAMED, "u1")),
    "opaque": (put, "sigma", np.zeros(70, "V8")),
    "object_references": (references,),
    "region_references": (region_references,),
    "variable_length_numbers": with_words(
        put, path="sigma", data=None, dtype=h5py.vlen_dtype("<f8"), shape=(70,)),
    "variable_length_labels": (
        put, "registration/labels", [f"x{i}" for i in range(9)], h5py.string_dtype()),
    "named_type": (named_type,),
    "array_type": (put, "sigma", np.zeros(70, [("a", "<f4", (2,))])),
    # Shapes and values.
    "scalar_dataset": (put, "sigma", 1e-5),
    "null_dataset": (put, "sigma", h5py.Empty("<f8")),
    "three_dimensions": (put, "points", np.zeros((70, 3, 1))),
    "no_provenance": (replaced, "provenance", None),
    "infinite_stiffness": (element, "rendering/stiffness", 1, np.inf),
    "nan_attribute": (attribute, "rendering", "contact_radius_m", np.nan, "<f8"),
    "negative_sigma": (element, "sigma", 5, -1e-9),
    "no_contact_radius": (attribute, "rendering", "contact_radius_m", 0.0, "<f8"),
    "unknown_frame": (text_at, "/", "frame", "world"),
    "two_for_a_truth": (element, "curve/closed", 0, 2),
    "transform_for_another_source": (text_at, "registration", "source_frame", "patient_lps"),
    "time_with_arabic_digits": (text_at, SHARED, "created_utc", "٢٠٢٦-01-02T03:04:05Z"),
    "setting_beyond_float64": (element, SETTINGS, 0, b"1e999"),
    # Findings and review.
    "place_of_a_finding_without_its_flag": with_words(findings, place=True),
    "finding_without_words": (findings, "text"),
    "review_of_nothing": with_words(review, digest=None),
    # Format and version.
    "format_of_5000_bytes": (text_at, "/", "format", "vfplan-fixture".ljust(5000, "x")),
    "earlier_major_version": (text_at, "/", "version", "1.1"),
    "version_of_no_form": (text_at, "/", "version", "2.0 beta"),
    "newer_minor_with_a_soft_link": (newer_minor, ("soft", h5py.SoftLink("/points"))),
    # Guides, lines and arcs.
    "guide_without_a_width": with_words(guide, radius=0.0),
    "guide_without_its_ends": with_words(guide, ends=None),
    "more_than_half_a_circle": with_words(pieces, bulges=(0.0, 1.5, 0.0, 0.0, 0.0)),
    "pieces_of_one_stroke_alone": with_words(pieces, stroke=(0, 0, 0, 0, 0)),
    "pieces_without_bulges": with_words(pieces, bulges=None),
    "fewer_bulges_than_vertices": with_words(pieces, bulges=(0.0, 0.5, 0.0)),
}
# fmt: on
ACCEPTED = {
    "untouched": lambda f: None,
    "newer_minor_with_unknown_optional_parts": newer_minor,
    "one_open_finding": findings,
    "a_review": review,
    "a_stroke_that_guides": guide,
}


# --- Files that h5py does not write -------------------------------------------------------------


def raw():
    """(name, payload) of files made byte by byte, or by other settings of libhdf5."""
    good, later = sound(), changed(newer_minor)
    yield "empty", b""
    yield "signature_only", good[:8]
    yield "superblock_only", good[:48]
    yield "no_hdf5", b"\0" * 4096
    yield "user_block_inside", b"\0" * 512 + good
    yield "csv", b"x,y,z\n1,2,3\n"
    yield "old_superblock", _written(("earliest", "v110"))
    yield "newer_superblock", _written(("v110", "v110"))
    yield "base_address_that_wraps_around", _with(good, 12, (2**64 - 256).to_bytes(8, "little"))
    yield "float64_of_another_normalization", _normalized(good)
    yield "link_that_is_not_utf8", _renamed(later, b"surprise", b"\xffurprise")
    yield "attribute_that_is_not_utf8", _renamed(later, b"colour\0", b"\xfeolour\0")
    yield "name_between_the_objects", _hidden(good)
    yield "rests_of_what_was_deleted", changed(replaced, "sigma", None, swept=False)
    yield "gap_beside_an_empty_message", _with_gap(good)
    yield "root_that_is_no_group", _without_link_info(good)


def _with(payload: bytes, at: int, value: bytes) -> bytes:
    """The payload with other bytes in a place, and all checksums made anew."""
    return fuzz_bundle.repaired(payload[:at] + value + payload[at + len(value) :])


def _with_gap(payload: bytes) -> bytes:
    """An empty message is three bytes shorter, which leaves a gap beside it; libhdf5 refuses."""
    data = bytearray(payload)
    for _, end, messages in hdf5_spans.headers(payload):
        empty = [first for kind, first, _ in messages if kind == hdf5_spans.NIL]
        last_kind, first, last = messages[-1]
        if empty and last_kind == hdf5_spans.NIL and last == end - 4 and last - first > 3:
            data[first - 3 : first - 1] = (last - first - 3).to_bytes(2, "little")
    assert bytes(data) != payload
    return fuzz_bundle.repaired(bytes(data))


def _without_link_info(payload: bytes) -> bytes:
    """The root's link info has the number of a datatype: libhdf5 takes it for no group."""
    blocks = (messages for _, _, messages in hdf5_spans.headers(payload))  # the root's come first
    first = next(first for messages in blocks for kind, first, _ in messages if kind == 0x02)
    return _with(payload, first - 4, b"\x03")


def _normalized(payload: bytes) -> bytes:
    """The attribute band_m with normalization 3, of which libhdf5 knows nothing, and crashes."""
    at = payload.index(b"\x11\x20\x3f\0", payload.index(b"band_m\0"))
    return _with(payload, at + 1, b"\x30")


def _renamed(payload: bytes, old: bytes, new: bytes) -> bytes:
    assert payload.count(old) == 1
    return fuzz_bundle.repaired(payload.replace(old, new))


def _hidden(payload: bytes) -> bytes:
    """Somebody's name where nothing is: between two objects."""
    known = [range(a, b) for a, b, _ in hdf5_spans.spans(payload)]
    for first, end in hdf5_spans.rests(payload):
        if end - first >= 8 and not any(first in span for span in known):
            return _with(payload, first, b"DOE^JANE")
    raise AssertionError("no room for a name")


def _written(libver) -> bytes:
    stream = io.BytesIO()
    with h5py.File(io.BytesIO(sound()), "r") as a, h5py.File(stream, "w", libver=libver) as b:
        for name in a:
            a.copy(name, b)
        for name in a.attrs:
            text(b, name, a.attrs[name])
    return stream.getvalue()


def whole_files():
    """(name, bytes) of files whose seal and payload do not fit together."""
    good = sound()
    data = damage.sealed(good)
    yield "seal_cut_by_a_byte", data[:-1]
    yield "a_second_seal", data + data[-damage.SEAL :]
    yield "a_bundle_in_a_bundle", damage.sealed(data)
    yield "end_of_file_beyond_the_file", damage.sealed(good, end=len(data) + 8)
    yield "seal_in_front", b"VFPLSEAL" + data[8:]
    yield "seal_of_another_length", vectors.with_seal(12, (1024).to_bytes(4, "little"), data)
    yield "unsigned_seal_with_a_case", vectors.with_seal(144, b"\x03\0", data)


def files():
    """(name, sealed bytes, whether it must be read) of the whole corpus."""
    for _, name, _, make, *words in vectors.VECTORS:
        yield f"kit_{name}", make(*words), False
    for name, (function, *words) in CASES.items():
        yield name, damage.sealed(changed(function, *words)), False
    for name, payload in raw():
        yield name, damage.sealed(payload), False
    for name, data in whole_files():
        yield name, data, False
    for name, function in ACCEPTED.items():
        yield name, damage.sealed(changed(function)), True
    for name, data in kit.valid_files():
        yield f"kit_{name}", data, True
