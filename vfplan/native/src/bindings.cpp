// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The Python face of the native engine: the only file that includes nanobind. No logic here.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>

#include "vfplan/engine_plain.hpp"
#include "vfplan/version.hpp"

namespace nb = nanobind;
using vfplan::plain::Engine;
using Rows = nb::ndarray<const double, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
template <typename T, int K>
using Out = nb::ndarray<T, nb::ndim<K>, nb::c_contig, nb::device::cpu>;

NB_MODULE(_core, m) {
    m.doc() = "vfplan's native proxy engine";
    m.attr("__version__") = VFPLAN_VERSION;
    nb::class_<Engine>(m, "Engine")
        .def("__init__",
             [](Engine* self, Rows points, bool robust, double rc, double band, double rv,
                double r3, double xi, std::array<double, 3> K, std::array<double, 3> axis,
                bool planar, int iterations) {
                 std::vector<vfplan::plain::V> p(points.shape(0));
                 for (size_t i = 0; i < p.size(); ++i)
                     p[i] = {points(i, 0), points(i, 1), points(i, 2)};
                 new (self) Engine(std::move(p),
                                   {robust, rc, band, rv, r3, xi, K, axis, planar, iterations});
             })
        .def("reset", [](Engine& e, std::array<double, 3> hip) { e.reset(hip); })
        .def("run", [](Engine& e, Rows hips, Out<double, 2> proxy, Out<double, 2> normal,
                       Out<double, 2> force, Out<int8_t, 1> state, Out<uint8_t, 1> status) {
            nb::gil_scoped_release release;
            for (size_t t = 0; t < hips.shape(0); ++t) {
                const auto s = e.step({hips(t, 0), hips(t, 1), hips(t, 2)});
                for (size_t k = 0; k < 3; ++k) {
                    proxy(t, k) = s.proxy[k];
                    normal(t, k) = s.normal[k];
                    force(t, k) = s.force[k];
                }
                state(t) = static_cast<int8_t>(s.state);
                status(t) = static_cast<uint8_t>(s.status);
            }
        });
}
