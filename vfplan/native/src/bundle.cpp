// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The Python face of the bundle's reader. No logic here.
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include "numpy.hpp"
#include "vfplan/bundle/fixture.hpp"

namespace vb = vfplan::bundle;

namespace {

vb::View view(const nb::bytes& data) {
    return {reinterpret_cast<const unsigned char*>(data.c_str()), data.size()};
}

nb::bytes to_bytes(vb::View data) { return nb::bytes(data.data(), data.size()); }

nb::object to_python(vb::Value&& value) {
    return value.visit([&]<class T>(std::vector<T>& all) -> nb::object {
        if (value.shape.empty()) return nb::cast(all[0]);
        if constexpr (std::is_arithmetic_v<T>) return array(std::move(all), value.shape);
        return nb::tuple(nb::cast(all));
    });
}

/// ({path: value}, [(location, code, severity, message)])
nb::tuple read(vb::View payload, std::uint64_t file_length, bool strict, const vb::Seal* seal) {
    vb::Findings findings(strict);
    vb::Content content;
    {
        nb::gil_scoped_release release;
        content = vb::read_payload(payload, file_length, findings, seal);
    }
    nb::dict values;
    for (auto& [path, value] : content) values[path.c_str()] = to_python(std::move(value));
    nb::list found;
    for (const vb::Finding& f : findings.all()) {
        const std::string where = f.where.empty() ? "/" : f.where;
        found.append(nb::make_tuple(where, f.code, f.error ? "error" : "note", f.message));
    }
    return nb::make_tuple(values, found);
}

/// A bundle's bytes, and its seal, which holds.
struct Sealed : vb::Seal {
    explicit Sealed(nb::bytes bytes) : data(std::move(bytes)) {
        const vb::View all = view(data);
        nb::gil_scoped_release release;
        static_cast<vb::Seal&>(*this) = vb::unseal(all, payload);
    }
    nb::bytes data;
    vb::View payload;
};

/// Throws std::invalid_argument unless all numbers name one of `count` things.
void check_numbers(std::span<const std::int32_t> numbers, std::size_t count) {
    for (const std::int32_t number : numbers)
        if (number < 0 || static_cast<std::size_t>(number) >= count)
            throw std::invalid_argument("vfplan: a number of a point or a stroke is not there");
}

/// The certificate of a fixture: kind, largest opening [m], limit [m], whether the proxy is held
/// back, and the points around the largest opening.
nb::tuple certificate(const Rows& points, const std::optional<vfplan::Vec3>& axis, double reach,
                      const Ids& stroke, const Flags& closed, const Triples& triangles,
                      std::optional<double> sample_radius) {
    const vb::detail::CertifiedShape shape{
        .points = {points.data(), points.size()},
        .axis = axis.value_or(vfplan::Vec3{}),
        .stroke = {stroke.data(), stroke.size()},
        .closed = {closed.data(), closed.size()},
        .triangles = {triangles.data(), triangles.size()},
        .sample_radius = sample_radius.value_or(vfplan::infinity)};
    vb::detail::Certificate made;
    {
        nb::gil_scoped_release release;
        check_numbers(shape.triangles, points.shape(0));
        check_numbers(shape.stroke, shape.closed.size());
        if (!shape.stroke.empty() && shape.stroke.size() != points.shape(0))
            throw std::invalid_argument("vfplan: each point needs the number of its stroke");
        made = vb::detail::certify(shape, reach);
    }
    return nb::make_tuple(made.kind, made.largest, made.limit, made.holds(), made.rows);
}

/// BundleError -> the Python exception of the same kind, with `where` and `code`.
void translate(const std::exception_ptr& thrown, void*) {
    try {
        std::rethrow_exception(thrown);
    } catch (const vb::BundleError& error) {
        const nb::object kind =
            nb::module_::import_("vfplan.errors").attr(std::string(error.kind()).c_str());
        const nb::object where = error.where.empty() ? nb::none() : nb::cast(error.where);
        nb::object made = kind(error.message, "where"_a = where);
        made.attr("code") = error.code;
        PyErr_SetObject(kind.ptr(), made.ptr());
    }
}

}  // namespace

void bind_bundle(nb::module_& m) {
    nb::register_exception_translator(translate);
    m.def(
        "read_payload",
        [](const nb::bytes& payload, std::uint64_t file_length, bool strict) {
            return read(view(payload), file_length, strict, nullptr);
        },
        "payload"_a, "file_length"_a, "strict"_a = true);
    m.def(
        "lookup3", [](const nb::bytes& data) { return vb::detail::lookup3(view(data)); }, "data"_a,
        "The checksum of HDF5's metadata");
    m.def("certificate", &certificate, "points"_a, "axis"_a.none(), "reach"_a,
          "stroke"_a.none() = nb::none(), "closed"_a.none() = nb::none(),
          "triangles"_a.none() = nb::none(), "sample_radius"_a = nb::none(),
          "what the leak certificate of a fixture must say");
    nb::class_<Sealed>(m, "Sealed", "A bundle's bytes, whose seal holds")
        .def(nb::init<nb::bytes>(), "data"_a)
        .def(
            "read",
            [](const Sealed& s, bool strict) { return read(s.payload, s.data.size(), strict, &s); },
            "strict"_a = true)
        .def_ro("data", &Sealed::data)
        .def_prop_ro("payload", [](const Sealed& s) { return to_bytes(s.payload); })
        .def_prop_ro("sha256", [](const Sealed& s) { return to_bytes(s.digest); })
        .def_ro("signed", &Sealed::is_signed)
        .def_ro("despite_findings", &Sealed::despite_findings)
        .def_prop_ro("key_id", [](const Sealed& s) { return to_bytes(s.key_id); })
        .def_prop_ro("signature", [](const Sealed& s) { return to_bytes(s.signature); })
        .def_prop_ro("signed_message", [](const Sealed& s) { return to_bytes(s.signed_message); })
        .def_ro("case", &Sealed::case_token)
        .def_ro("robot_serial", &Sealed::robot_serial)
        .def_ro("signed_at", &Sealed::signed_at);
}
