// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The Python face of the guide. No logic here.
#include <nanobind/stl/vector.h>

#include "ticks.hpp"

namespace {

// Points of the curve (M, 3) at arc lengths.
nb::object at(const Guide& guide, std::size_t strand, const std::vector<double>& arcs) {
    if (strand >= guide.path().strands().size()) throw nb::index_error("there is no such strand");
    auto out = array<double>(arcs.size(), 3);
    for (std::size_t i = 0; i < arcs.size(); ++i) {
        const vfplan::Vec3 x = guide.path().at(strand, arcs[i]) + guide.along_axis();
        std::memcpy(out.data() + 3 * i, x.c, sizeof x.c);
    }
    return nb::cast(out);
}

nb::object tight_bend(const Guide& guide) {
    const vfplan::TubeObstacle n = vfplan::tight_bend(guide.path(), guide.parameters().radius);
    if (!n.found) return nb::none();
    return nb::make_tuple(n.strand, n.arc, n.at + guide.along_axis());
}

}  // namespace

void bind_guide(nb::module_& m) {
    using vfplan::GuideParameters;
    nb::class_<GuideParameters>(m, "GuideParameters", "How a guide holds the tip, SI")
        .def(nb::init<double, double, vfplan::Ends, vfplan::Hold, bool, std::optional<vfplan::Vec3>,
                      double, double, double>(),
             nb::kw_only(), "radius"_a, "stiffness"_a, "ends"_a, "hold"_a, "cut_bends"_a,
             "ignore_axis"_a.none(), "lead_force"_a, "lead_speed"_a, "period"_a);
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
            "__init__",
            [](Guide* self, const Rows& vertices, const Numbers& bulges, const Ids& stroke,
               const Flags& closed, const GuideParameters& p) {
                new (self) Guide(strokes(vertices, bulges, stroke, closed), p);
            },
            "vertices"_a, "bulges"_a, "stroke"_a, "closed"_a, "parameters"_a)
        .def("reset", &reset<Guide>, "hip"_a)
        .def("run", &run<Guide>, "hips"_a)
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
