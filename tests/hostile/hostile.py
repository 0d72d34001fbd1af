"""Hostile bundles, each sealed correctly: what the parser behind the seal must refuse.

`CASES` maps a name to a function that damages an open h5py.File of a sound bundle, `ACCEPTED`
holds what must be read all the same; `files()` yields the whole corpus.
"""

from __future__ import annotations

import hashlib
import io
import re

import bundles
import damage
import fuzz_bundle
import h5py
import hdf5_spans
import numpy as np

from vfplan.bundle import seal
from vfplan.bundle.content import to_content
from vfplan.bundle.write import completed, to_payload

CASES = {}
ACCEPTED = {}


def case(function):
    CASES[function.__name__] = function
    return function


def accepted(function):
    ACCEPTED[function.__name__] = function
    return function


def sound() -> bytes:
    return to_payload(completed(to_content(bundles.whole())))


def changed(function, *, swept=True) -> bytes:
    """A sound payload that `function` changed; what h5py deleted is gone unless told otherwise."""
    stream = io.BytesIO(sound())
    with h5py.File(stream, "r+", libver=("v108", "v110")) as file:
        function(file)
    data = bytearray(stream.getvalue())
    if swept:
        for first, end in hdf5_spans.rests(bytes(data)):
            data[first:end] = bytes(end - first)
    return fuzz_bundle.repaired(bytes(data))


def put(file, path, data, *, dtype=None, attributes=None, **options):
    """Replace a dataset by another with the same attributes."""
    kept = dict(file[path].attrs)
    del file[path]
    new = file.create_dataset(path, data=data, dtype=dtype, **options)
    for name, value in (kept if attributes is None else attributes).items():
        text(new, name, value)


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


def number(where, name, value, dtype):
    del where.attrs[name]
    where.attrs.create(name, value, dtype=dtype)


# --- storage that reaches out of the file, or claims what is not there -------------------------


@case
def external_raw_storage(f):
    del f["sigma"]
    f.create_dataset("sigma", (70,), "<f8", external=[("/etc/passwd", 0, 560)])


@case
def external_link(f):
    del f["sigma"]
    f["sigma"] = h5py.ExternalLink("/etc/passwd", "/points")


@case
def external_link_to_a_group(f):
    del f["curve"]
    f["curve"] = h5py.ExternalLink("other.h5", "/curve")


@case
def soft_link(f):
    del f["sigma"]
    f["sigma"] = h5py.SoftLink("/registration/tre")


@case
def soft_link_to_nowhere(f):
    f["curve/more"] = h5py.SoftLink("/nowhere")


@case
def soft_link_to_itself(f):
    del f["sigma"]
    f["sigma"] = h5py.SoftLink("/sigma")


@case
def virtual_dataset(f):
    del f["sigma"]
    layout = h5py.VirtualLayout((70,), "<f8")
    layout[:] = h5py.VirtualSource("/etc/passwd", "x", (70,))
    f.create_virtual_dataset("sigma", layout)


@case
def shape_of_8_tib(f):
    del f["points"]
    f.create_dataset("points", (2**40, 3), "<f8")


@case
def more_points_than_are_stored(f):
    del f["points"]
    f.create_dataset("points", (4_000_000, 3), "<f8")


@case
def chunks_of_4_gib(f):
    del f["points"]
    f.create_dataset("points", (70, 3), "<f8", maxshape=(None, 3), chunks=(2**27, 3))


@case
def chunks(f):
    put(f, "sigma", np.full(70, 1.2e-5), chunks=(70,))


@case
def chunks_with_a_checksum(f):
    """As versions 1.0 and 1.1 stored every table."""
    put(f, "sigma", np.full(70, 1.2e-5), chunks=(70,), fletcher32=True)


@case
def data_that_were_never_written(f):
    del f["sigma"]
    f.create_dataset("sigma", (70,), "<f8")


@case
def deflate_bomb(f):
    put(f, "points", np.zeros((4_000_000, 3)), compression="gzip", compression_opts=9)


@case
def deflate_beside_fletcher32(f):
    put(f, "sigma", np.zeros(70), compression="gzip")


@case
def shuffle(f):
    put(f, "sigma", np.zeros(70), shuffle=True)


@case
def lzf(f):
    put(f, "sigma", np.zeros(70), compression="lzf")


@case
def scale_offset(f):
    put(f, "curve/stroke", np.repeat([0, 1], [40, 30]), dtype="<i4", scaleoffset=0)


@case
def unknown_filter(f):
    dcpl = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    dcpl.set_chunk((70,))
    dcpl.set_filter(32123, h5py.h5z.FLAG_OPTIONAL, (1, 2, 3))
    del f["sigma"]
    space = h5py.h5s.create_simple((70,))
    h5py.h5d.create(f.id, b"sigma", h5py.h5t.IEEE_F64LE, space, dcpl=dcpl)


@case
def unknown_filter_after_the_checksum(f):
    dcpl = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    dcpl.set_chunk((70,))
    dcpl.set_fletcher32()
    dcpl.set_filter(32123, h5py.h5z.FLAG_OPTIONAL, ())
    del f["sigma"]
    space = h5py.h5s.create_simple((70,))
    h5py.h5d.create(f.id, b"sigma", h5py.h5t.IEEE_F64LE, space, dcpl=dcpl)


@case
def compact_layout(f):
    del f["sigma"]
    dcpl = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    dcpl.set_layout(h5py.h5d.COMPACT)
    space = h5py.h5s.create_simple((70,))
    h5py.h5d.create(f.id, b"sigma", h5py.h5t.IEEE_F64LE, space, dcpl=dcpl)


@case
def growing_dataset(f):
    put(f, "sigma", np.zeros(70), maxshape=(None,))


# --- links and objects ---------------------------------------------------------------------


@case
def cycle_to_the_root(f):
    del f["curve"]
    f["curve"] = f["/"]


@case
def cycle_in_a_group(f):
    f["curve/curve"] = f["curve"]


@case
def group_twice(f):
    del f["image"]
    f["image"] = f["curve"]


@case
def dataset_twice(f):
    del f["sigma"]
    f["sigma"] = f["registration/tre"]


@case
def dataset_where_a_group_should_be(f):
    del f["image"]
    f["image"] = np.zeros(3)


@case
def group_where_a_dataset_should_be(f):
    del f["sigma"]
    f.create_group("sigma")


@case
def named_type_where_a_dataset_should_be(f):
    del f["sigma"]
    f["sigma"] = np.dtype("<f8")


@case
def ten_thousand_links(f):
    for i in range(10_000):
        f.create_group(f"curve/{i}")


@case
def unknown_dataset(f):
    f["surprise"] = np.zeros(3)


@case
def long_name(f):
    f.create_group("n" * 60_000)


@case
def unknown_group(f):
    f.create_group("curve/surprise")


@case
def unknown_attribute(f):
    text(f["points"], "surprise", "boo")


@case
def unknown_attribute_of_the_root(f):
    text(f, "surprise", "boo")


# --- attributes ----------------------------------------------------------------------------


@case
def huge_attribute(f):
    del f.attrs["frame"]
    f.attrs["frame"] = np.zeros(60_000, "u1")


@case
def huge_text(f):
    text(f, "frame", "x" * 5000)


@case
def dense_huge_attribute(f):
    del f["points"].attrs["unit"]
    f["points"].attrs.create("unit", np.zeros(20_000_000, "u1"))


@case
def thousand_attributes(f):
    for i in range(1000):
        f["points"].attrs[f"a{i}"] = i


@case
def variable_length_text(f):
    f.attrs["frame"] = "robot_base"


@case
def text_array(f):
    del f.attrs["frame"]
    f.attrs["frame"] = np.array([b"robot_base"])


@case
def empty_attribute(f):
    del f.attrs["frame"]
    f.attrs["frame"] = h5py.Empty("S10")


@case
def text_with_control_characters(f):
    text(f["provenance"], "software", "vfplan\x1b[2J")


@case
def text_with_c1_controls(f):
    text(f["provenance"], "software", "vf\u0085plan")


@case
def text_that_is_not_utf8(f):
    text(f["provenance"], "software", b"\xff\xfe")


@case
def text_with_a_surrogate(f):
    text(f["provenance"], "software", b"a\xed\xa0\x80b")


@case
def text_with_an_overlong_form(f):
    text(f["provenance"], "software", b"a\xc0\xafb")


@case
def text_padded_with_blanks(f):
    text(f, "frame", "robot_base", strpad=h5py.h5t.STR_SPACEPAD)


@case
def text_with_zero_inside(f):
    text(f["provenance"], "software", b"vf\0plan")


@case
def number_for_text(f):
    del f.attrs["frame"]
    f.attrs["frame"] = 7


@case
def text_for_a_number(f):
    text(f["rendering"], "band_m", "1e-5")


# --- types ---------------------------------------------------------------------------------


@case
def float32(f):
    put(f, "sigma", np.zeros(70), dtype="<f4")


@case
def big_endian(f):
    put(f, "sigma", np.zeros(70), dtype=">f8")


@case
def integers(f):
    put(f, "sigma", np.zeros(70), dtype="<i8")


@case
def wide_attribute(f):
    number(f["image"], "width_px", 871, "<i8")


@case
def single_precision_attribute(f):
    number(f["rendering"], "band_m", 1e-5, "<f4")


@case
def compound(f):
    put(f, "sigma", np.zeros(70, [("a", "<f4"), ("b", "<i4")]))


@case
def enum(f):
    put(f, "curve/bridged", np.zeros(70, "u1"), dtype=h5py.enum_dtype({"no": 0, "yes": 1}, "u1"))


@case
def booleans(f):
    put(f, "curve/bridged", np.zeros(70, bool))


@case
def opaque(f):
    put(f, "sigma", np.zeros(70, "V8"))


@case
def object_references(f):
    put(f, "sigma", np.array([f.ref] * 70, dtype=h5py.ref_dtype))


@case
def region_references(f):
    r = f["points"].regionref[:3]
    put(f, "sigma", np.array([r] * 70, dtype=h5py.regionref_dtype))


@case
def variable_length_numbers(f):
    put(f, "sigma", None, dtype=h5py.vlen_dtype("<f8"), shape=(70,))


@case
def variable_length_labels(f):
    put(f, "registration/labels", [f"x{i}" for i in range(9)], dtype=h5py.string_dtype())


@case
def named_type(f):
    f["curve/kind"] = np.dtype("<f8")
    put(f, "sigma", np.zeros(70), dtype=f["curve/kind"])
    del f["curve/kind"]


@case
def array_type(f):
    put(f, "sigma", np.zeros(70, [("a", "<f4", (2,))]))


# --- shapes and values -----------------------------------------------------------------------


@case
def scalar_dataset(f):
    put(f, "sigma", 1e-5)


@case
def null_dataset(f):
    put(f, "sigma", h5py.Empty("<f8"))


@case
def two_columns(f):
    put(f, "points", np.zeros((70, 2)))


@case
def three_dimensions(f):
    put(f, "points", np.zeros((70, 3, 1)))


@case
def another_number_of_sigmas(f):
    put(f, "sigma", np.full(69, 1e-5))


@case
def no_points(f):
    del f["points"]


@case
def no_frame(f):
    del f.attrs["frame"]


@case
def no_provenance(f):
    del f["provenance"]


@case
def no_unit(f):
    put(f, "points", f["points"][:], attributes={"frame": "robot_base"})


@case
def points_in_mm(f):
    text(f["points"], "unit", "mm")


@case
def points_in_another_frame(f):
    text(f["points"], "frame", "patient_lps")


@case
def numbers_in_mm_that_say_m(f):
    put(f, "points", f["points"][:] * 1000)


@case
def nan(f):
    f["points"][3, 1] = np.nan


@case
def infinite_stiffness(f):
    f["rendering/stiffness"][1] = np.inf


@case
def nan_attribute(f):
    number(f["rendering"], "contact_radius_m", np.nan, "<f8")


@case
def negative_sigma(f):
    f["sigma"][5] = -1e-9


@case
def negative_stiffness(f):
    f["rendering/stiffness"][0] = -1


@case
def no_contact_radius(f):
    number(f["rendering"], "contact_radius_m", 0.0, "<f8")


@case
def image_of_no_width(f):
    number(f["image"], "width_px", 0, "<i4")


@case
def unknown_frame(f):
    text(f, "frame", "world")


@case
def unknown_model(f):
    text(f["registration"], "model", "projective")


@case
def stroke_that_goes_back(f):
    f["curve/stroke"][50] = 0


@case
def stroke_that_jumps(f):
    f["curve/stroke"][40:] = 2


@case
def two_for_a_truth(f):
    f["curve/closed"][0] = 2


@case
def axis_of_length_2(f):
    f["rendering/ignore_axis"][:] = f["rendering/ignore_axis"][:] * 0.5


@case
def band_as_wide_as_the_radius(f):
    number(f["rendering"], "band_m", 0.005, "<f8")


@case
def transform_for_another_source(f):
    text(f["registration"], "source_frame", "patient_lps")


@case
def negative_variance(f):
    f["registration/covariance"][4, 4] = -1e-12


@case
def markers_of_the_same_name(f):
    f["registration/labels"][1] = b"x1"


@case
def rendering_of_an_image(f):
    text(f, "frame", "image")
    text(f["points"], "frame", "image")
    text(f["points"], "unit", "px")


@case
def time_of_no_form(f):
    text(f["provenance"], "created_utc", "yesterday")


@case
def time_with_arabic_digits(f):
    text(f["provenance"], "created_utc", "٢٠٢٦-01-02T03:04:05Z")


@case
def hash_of_no_form(f):
    f["provenance/input_sha256"][0] = b"zz" * 32


@case
def setting_of_no_form(f):
    f["provenance/setting_values"][0] = b"{}"


@case
def setting_beyond_float64(f):
    f["provenance/setting_values"][0] = b"1e999"


@case
def names_without_values(f):
    del f["provenance/setting_values"]


@case
def role_that_is_a_path(f):
    f["provenance/input_roles"][0] = b"/home"


@case
def another_geometry(f):
    points = f["points"][:]
    points[7, 0] += 1e-6
    f["points"][:] = points


# --- the leak certificate ----------------------------------------------------------------------


@case
def no_certificate(f):
    del f["leak"]


@case
def certificate_of_another_kind(f):
    text(f["leak"], "kind", "cloud")


@case
def certificate_of_a_smaller_gap(f):
    number(f["leak"], "largest_m", 1e-3, "<f8")


@case
def certificate_with_another_limit(f):
    number(f["leak"], "limit_m", 1.0, "<f8")


@case
def certificate_withheld(f):
    number(f["leak"], "certified", 0, "u1")


@case
def certified_leak(f):
    """The gaps stay; a thinner proxy passes through them."""
    number(f["rendering"], "contact_radius_m", 0.001, "<f8")
    number(f["leak"], "limit_m", 2 * (0.001 - 1e-5), "<f8")


@case
def bare_cloud_called_certified(f):
    del f["curve"]
    del f["leak/open_ends"], f["leak/between_place"], f["leak"].attrs["between_m"]
    del f["leak"].attrs["limit_m"]
    text(f["leak"], "kind", "cloud")


# --- findings and review -----------------------------------------------------------------------


def findings(f, **change):
    """One open doubt, with what `change` puts in place of its values."""
    texts = {"code": "odd", "severity": "doubt", "text": "Odd.", "stage": "plan"}
    group = f.create_group("findings")
    for name, value in (texts | change).items():
        group.create_dataset(name, data=np.array([value.encode()]))


@case
def finding_of_an_unknown_severity(f):
    findings(f, severity="error")


@case
def finding_with_a_code_of_two_words(f):
    findings(f, code="very odd")


@case
def finding_answered_by_somebody_at_no_time(f):
    findings(f, answered_by="A. Planner")


@case
def finding_with_a_place_that_is_not_there(f):
    findings(f)
    group = f["findings"]
    text(group.create_dataset("has_place_px", data=np.zeros(1, "u1")), "unit", "1")
    place = group.create_dataset("place_px", data=np.ones((1, 2)))
    text(place, "unit", "px")
    text(place, "frame", "image")


@case
def place_of_a_finding_without_its_flag(f):
    findings(f)
    place = f["findings"].create_dataset("place_px", data=np.ones((1, 2)))
    text(place, "unit", "px")
    text(place, "frame", "image")


@case
def finding_without_words(f):
    findings(f)
    del f["findings/text"]


def review(f, **change):
    group = f.create_group("review")
    values = {"by": "A. Planner", "utc": "2026-01-02T03:04:05Z", "digest": "0f" * 32} | change
    for name, value in values.items():
        if value is not None:
            text(group, name, value)


@case
def review_by_nobody(f):
    review(f, by="\0")


@case
def review_at_no_time(f):
    review(f, utc="yesterday")


@case
def review_of_nothing(f):
    review(f, digest=None)


@accepted
def one_open_finding(f):
    findings(f)


@accepted
def a_review(f):
    review(f)


# --- format and version ----------------------------------------------------------------------


@case
def another_format(f):
    text(f, "format", "vfplan-result")


@case
def format_of_5000_bytes(f):
    text(f, "format", "vfplan-fixture".ljust(5000, "x"))


@case
def next_major_version(f):
    text(f, "version", "3.0")


@case
def earlier_major_version(f):
    text(f, "version", "1.1")


@case
def version_of_no_form(f):
    text(f, "version", "2.0 beta")


@case
def version_with_a_leading_zero(f):
    text(f, "version", "2.00")


@case
def newer_minor_that_must_be_understood(f):
    text(f, "version", "2.7")
    f["surprise"] = np.zeros(3)
    text(f, "must_understand", "/points /surprise")


@case
def newer_minor_with_a_soft_link(f):
    text(f, "version", "2.7")
    f["surprise"] = h5py.SoftLink("/points")


def guide(f, *, understand="/guidance", radius=1e-3, ends="stop", stroke=1):
    if understand:
        text(f, "must_understand", understand)
    group = f.create_group("guidance")
    for name, value, dtype in (("radius_m", radius, "<f8"), ("stiffness_n_per_m", 800.0, "<f8")):
        group.attrs.create(name, value, dtype=dtype)
    text(group, "ends", ends)
    group.attrs.create("stroke", stroke, dtype="<i4")


@case
def guide_that_need_not_be_understood(f):
    guide(f, understand="")


@case
def guide_along_a_stroke_that_is_not_there(f):
    guide(f, stroke=2)


@case
def guide_without_a_width(f):
    guide(f, radius=0.0)


@case
def guide_with_unknown_ends(f):
    guide(f, ends="wrap")


@case
def guide_without_its_ends(f):
    guide(f)
    del f["guidance"].attrs["ends"]


def pieces(f, *, bulges=(0.0, 0.5, 0.0, 1.0, 1.0), stroke=(0, 0, 0, 1, 1), error=1e-6):
    """Lines and arcs of the arc and the ring."""
    group = f.create_group("pieces")
    group.attrs.create("error_m", error, dtype="<f8")
    frame, plain = {"unit": "m", "frame": "robot_base"}, {"unit": "1"}
    for name, values, dtype, attributes in (
        ("vertices", f["points"][:5], "<f8", frame),
        ("bulges", bulges, "<f8", plain),
        ("stroke", stroke, "<i4", plain),
    ):
        new = group.create_dataset(name, data=np.array(values, dtype))
        for key, value in attributes.items():
            text(new, key, value)


@case
def more_than_half_a_circle(f):
    pieces(f, bulges=(0.0, 1.5, 0.0, 0.0, 0.0))


@case
def pieces_of_a_stroke_that_is_not_there(f):
    pieces(f, stroke=(0, 0, 0, 1, 2))


@case
def pieces_of_one_stroke_alone(f):
    pieces(f, stroke=(0, 0, 0, 0, 0))


@case
def pieces_without_an_axis(f):
    pieces(f)
    del f["rendering/ignore_axis"]


@case
def pieces_without_bulges(f):
    pieces(f)
    del f["pieces/bulges"]


@case
def fewer_bulges_than_vertices(f):
    pieces(f, bulges=(0.0, 0.5, 0.0))


@case
def lines_and_arcs_of_another_curve(f):
    pieces(f)


@accepted
def a_stroke_that_guides(f):
    guide(f)


@accepted
def untouched(f):
    pass


@accepted
def newer_minor_with_unknown_optional_parts(f):
    text(f, "version", "2.7")
    f["surprise"] = np.zeros(3)
    f["curve/more"] = np.zeros(3, "S3")
    text(f["points"], "colour", "red")
    f["points"].attrs["weight"] = np.arange(5)


# --- files that h5py does not write ------------------------------------------------------------


def raw():
    """(name, payload) of files made byte by byte, or by other settings of libhdf5."""
    good = sound()
    yield "empty", b""
    yield "signature_only", good[:8]
    yield "superblock_only", good[:48]
    yield "no_hdf5", b"\0" * 4096
    yield "user_block_inside", b"\0" * 512 + good
    yield "bytes_after_the_end", good + b"DOE^JANE"
    yield "csv", b"x,y,z\n1,2,3\n"
    yield "old_superblock", _written(("earliest", "v110"))
    yield "newer_superblock", _written(("v110", "v110"))
    yield "superblock_extension", _with_extension(good)
    yield "base_address_behind_a_user_block", _based(good, 512)
    yield "base_address_that_wraps_around", _based(good, 2**64 - 256)
    yield "float64_of_another_normalization", _normalized(good)
    yield "link_that_is_not_utf8", _renamed(newer(), b"surprise", b"\xffurprise")
    yield "attribute_that_is_not_utf8", _renamed(newer(), b"colour\0", b"\xfeolour\0")
    yield "name_between_the_objects", _hidden(good, between=True)
    yield "name_in_an_object_header", _hidden(good, between=False)
    yield "two_tables_in_one_place", _in_one_place(good)
    yield "rests_of_what_was_deleted", changed(_delete_sigma, swept=False)
    yield "gap_beside_an_empty_message", _with_gap(good)
    yield "root_that_is_no_group", _without_link_info(good)


def _delete_sigma(f):
    del f["sigma"]


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


def newer() -> bytes:
    return changed(newer_minor_with_unknown_optional_parts)


def _without_link_info(payload: bytes) -> bytes:
    """The root's link info has the number of a datatype: libhdf5 takes it for no group."""
    data = bytearray(payload)
    blocks = (messages for _, _, messages in hdf5_spans.headers(payload))  # the root's come first
    first = next(first for messages in blocks for kind, first, _ in messages if kind == 0x02)
    data[first - 4] = 0x03
    return fuzz_bundle.repaired(bytes(data))


def _normalized(payload: bytes) -> bytes:
    """The attribute band_m with normalization 3, of which libhdf5 knows nothing, and crashes."""
    data = bytearray(payload)
    at = data.index(b"\x11\x20\x3f\0", data.index(b"band_m\0"))
    data[at + 1] |= 0x10
    return fuzz_bundle.repaired(bytes(data))


def _renamed(payload: bytes, old: bytes, new: bytes) -> bytes:
    assert payload.count(old) == 1
    return fuzz_bundle.repaired(payload.replace(old, new))


def _hidden(payload: bytes, *, between: bool) -> bytes:
    """Somebody's name where nothing is: between two objects, or in an empty header message."""
    data, name = bytearray(payload), b"DOE^JANE"
    known = [range(a, b) for a, b, _ in hdf5_spans.spans(payload)]
    for first, end in hdf5_spans.rests(payload):
        inside = any(first in span for span in known)
        if end - first >= len(name) and inside != between:
            data[first : first + len(name)] = name
            return fuzz_bundle.repaired(bytes(data))
    raise AssertionError("no room for a name")


def _in_one_place(payload: bytes) -> bytes:
    """The address of the data of /sigma is that of /registration/tre, which is as long."""
    data = bytearray(payload)
    size = (70 * 8).to_bytes(8, "little")
    one, other = (m.start() for m in re.finditer(rb"\x03\x01.{8}" + re.escape(size), payload, re.S))
    data[one + 2 : one + 10] = data[other + 2 : other + 10]
    return fuzz_bundle.repaired(bytes(data))


def _based(payload: bytes, base: int) -> bytes:
    """The payload with another base address."""
    data = bytearray(payload)
    data[12:20] = base.to_bytes(8, "little")
    return fuzz_bundle.repaired(bytes(data))


def _written(libver) -> bytes:
    stream = io.BytesIO()
    with h5py.File(io.BytesIO(sound()), "r") as a, h5py.File(stream, "w", libver=libver) as b:
        for name in a:
            a.copy(name, b)
        for name in a.attrs:
            text(b, name, a.attrs[name])
    return stream.getvalue()


def _with_extension(payload: bytes) -> bytes:
    """A superblock that names an extension: the root, as it happens."""
    data = bytearray(payload)
    data[20:28] = data[36:44]
    return fuzz_bundle.repaired(bytes(data))


def whole_files():
    """(name, bytes) of files whose seal and payload do not fit together."""
    good = sound()
    data = damage.sealed(good)
    length, block = len(data), data[-damage.SEAL :]
    yield "no_seal", data[: -damage.SEAL]
    yield "seal_cut_by_a_byte", data[:-1]
    yield "bytes_behind_the_seal", data + bytes(8)
    yield "a_second_seal", data + block
    yield "a_bundle_in_a_bundle", damage.sealed(data)
    yield "end_of_file_before_the_seal", damage.sealed(good, end=length - damage.SEAL)
    yield "end_of_file_beyond_the_file", damage.sealed(good, end=length + 8)
    yield "seal_in_front", b"VFPLSEAL" + data[8:]
    for name, at, value, width in (
        ("seal_of_a_later_version", 8, 3, 2),
        ("seal_with_an_unknown_flag", 10, 4, 2),
        ("seal_of_another_length", 12, 1024, 4),
        ("seal_of_another_payload", 16, length, 8),
        ("unsigned_seal_with_a_key", 56, 1, 1),
        ("unsigned_seal_with_a_case", 144, 3, 2),
        ("text_that_leaves_the_seal", 144, 400, 2),
    ):
        changed_seal = bytearray(block)
        changed_seal[at : at + width] = value.to_bytes(width, "little")
        yield name, damage.resealed(data[: -damage.SEAL] + bytes(changed_seal), damaged_seal=True)
    odd = data[: -damage.SEAL] + bytes(4)
    digest = hashlib.sha256(odd).digest()
    yield "payload_of_an_odd_length", odd + seal.to_bytes(seal.Seal(len(odd), digest))


def files():
    """(name, sealed bytes, whether it must be read) of the whole corpus."""
    for name, function in CASES.items():
        yield name, damage.sealed(changed(function)), False
    for name, payload in raw():
        yield name, damage.sealed(payload), False
    for name, data in whole_files():
        yield name, data, False
    for name, function in ACCEPTED.items():
        yield name, damage.sealed(changed(function)), True
    for name in ("drawn", "doubtful", "reviewed", "sheet", "patient", "pixels"):
        content = completed(to_content(getattr(bundles, name)()))
        yield name, damage.sealed(to_payload(content)), True
