// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The Python face of the guide. No logic here.
#include "vfplan/guide.hpp"

#include <nanobind/stl/vector.h>

#include "numpy.hpp"

namespace {

struct Guide : vfplan::Guide {
    using vfplan::Guide::Guide;
    std::atomic_flag busy = ATOMIC_FLAG_INIT;
};
struct Serving : Turn {
    explicit Serving(Guide& guide) : Turn(guide.busy, "Guide", "guide") {}
};

// Proxy, force (T, 3), arc, lateral, remaining (T,), strand, held, status (T,).
nb::tuple run(Guide& guide, const Rows& hips) {
    const Serving turn(guide);
    const std::size_t n = hips.shape(0);
    auto proxy = array<double>(n, 3), force = array<double>(n, 3);
    auto arc = array<double>(n, 1), lateral = array<double>(n, 1), remaining = array<double>(n, 1);
    auto strand = array<std::int32_t>(n, 1);
    auto held = array<bool>(n, 1);
    auto status = array<std::uint8_t>(n, 1);
    {
        nb::gil_scoped_release release;
        const double* h = hips.data();
        for (std::size_t i = 0; i < n; ++i) {
            const vfplan::GuideStep s = guide.step({{h[3 * i], h[3 * i + 1], h[3 * i + 2]}});
            std::memcpy(proxy.data() + 3 * i, s.proxy.c, sizeof s.proxy.c);
            std::memcpy(force.data() + 3 * i, s.force.c, sizeof s.force.c);
            arc.data()[i] = s.arc;
            lateral.data()[i] = s.lateral;
            remaining.data()[i] = s.remaining;
            strand.data()[i] = static_cast<std::int32_t>(s.strand);
            held.data()[i] = s.held;
            status.data()[i] = s.status;
        }
    }
    return nb::make_tuple(proxy, force, arc, lateral, remaining, strand, held, status);
}

// Points of the curve (M, 3) at arc lengths, across an ignored axis.
nb::object at(const Guide& guide, std::size_t strand, const std::vector<double>& arcs) {
    if (strand >= guide.path().strands().size()) throw nb::index_error("there is no such strand");
    auto out = array<double>(arcs.size(), 3);
    for (std::size_t i = 0; i < arcs.size(); ++i) {
        const vfplan::Vec3 x = guide.path().at(strand, arcs[i]);
        std::memcpy(out.data() + 3 * i, x.c, sizeof x.c);
    }
    return nb::cast(out);
}

nb::object tight_bend(const Guide& guide) {
    const vfplan::Narrow n = vfplan::tight_bend(guide.path(), guide.parameters().radius);
    if (!n.found) return nb::none();
    return nb::make_tuple(n.strand, n.arc, nb::make_tuple(n.at[0], n.at[1], n.at[2]));
}

}  // namespace

void bind_guide(nb::module_& m) {
    using vfplan::GuideParameters;
    nb::enum_<vfplan::Ends>(m, "Ends")
        .value("stop", vfplan::Ends::stop)
        .value("open", vfplan::Ends::open);
    nb::enum_<vfplan::Hold>(m, "Hold")
        .value("at_once", vfplan::Hold::at_once)
        .value("on_entry", vfplan::Hold::on_entry);
    nb::class_<GuideParameters>(m, "GuideParameters", "How a guide holds the tip, SI")
        .def(nb::init<>())
        .def_rw("radius", &GuideParameters::radius)
        .def_rw("stiffness", &GuideParameters::stiffness)
        .def_rw("ends", &GuideParameters::ends)
        .def_rw("hold", &GuideParameters::hold)
        .def_rw("cut_bends", &GuideParameters::cut_bends)
        .def_rw("lead_force", &GuideParameters::lead_force)
        .def_rw("lead_speed", &GuideParameters::lead_speed)
        .def_rw("period", &GuideParameters::period)
        .def("set_ignore_axis", [](GuideParameters& p, const Row& a) { p.ignore_axis = vec(a); });
    nb::class_<Guide>(m, "Guide")
        .def(
            "__init__",
            [](Guide* self, const Rows& points, const std::vector<std::size_t>& counts,
               const std::vector<bool>& closed, const GuideParameters& p) {
                nb::gil_scoped_release release;
                new (self) Guide(points.data(), counts, closed, p);
            },
            "points"_a, "counts"_a, "closed"_a, "parameters"_a)
        .def(
            "reset",
            [](Guide& g, const Row& hip) {
                const Serving turn(g);
                g.reset(vec(hip));
            },
            "hip"_a)
        .def("run", &run, "hips"_a)
        .def("at", &at, "strand"_a, "arcs"_a)
        .def("tight_bend", &tight_bend)
        .def_prop_ro("lengths",
                     [](const Guide& g) {
                         std::vector<double> lengths;
                         for (const auto& s : g.path().strands()) lengths.push_back(s.length);
                         return lengths;
                     })
        .def_prop_ro("bytes", &Guide::bytes);
}
