// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The Python face of the native engine. No logic here.
#include <nanobind/stl/pair.h>

#include "ticks.hpp"
#include "vfplan/cloud/band.hpp"
#include "vfplan/tick_time.hpp"
#include "vfplan/version.hpp"

void bind_beside(nb::module_& m);
void bind_bundle(nb::module_& m);
void bind_controller(nb::module_& m);
void bind_extraction(nb::module_& m);

namespace {

using vfplan::Parameters;

using Numbers32 = nb::ndarray<const std::uint32_t, nb::shape<-1>, nb::c_contig, nb::device::cpu>;

vfplan::mesh::Surface surface(const Rows& points, const Triples& triangles) {
    return {points.data(), points.shape(0), triangles.data(), triangles.shape(0)};
}

// Points (N, 3) and triangles (K, 3) of the same surface, sampled.
nb::tuple sampled(const Rows& points, const Triples& triangles, double cover,
                  std::optional<double> longest_side) {
    vfplan::mesh::OwnedSurface made;
    {
        nb::gil_scoped_release release;
        made = vfplan::mesh::sampled(surface(points, triangles), cover, longest_side);
    }
    const std::size_t n = made.points.size() / 3, k = made.triangles.size() / 3;
    return nb::make_tuple(array(std::move(made.points), {n, 3}),
                          array(std::move(made.triangles), {k, 3}));
}

// What is made of lines and arcs, or of a mesh: `shape` makes one of `names`.
template <class Shape, class... Args, class... Names>
void bind_shape(nb::module_& m, nb::class_<Engine>& engine, Shape (*shape)(const Args&...),
                const Names&... names) {
    m.def(
        "tick_time_bound",
        [shape](const Args&... args, const Parameters& p) {
            const Shape made = shape(args...);
            nb::gil_scoped_release release;
            return vfplan::tick_time_bound(made, p);
        },
        names..., "parameters"_a);
    engine.def(
        "__init__",
        [shape](Engine* self, const Args&... args, const Parameters& p) {
            const Shape made = shape(args...);
            nb::gil_scoped_release release;
            new (self) Engine(made, p);
        },
        names..., "parameters"_a);
}

// False where the loop takes up nothing.
bool edit(Engine& engine, const Numbers32& remove, const Rows& add) {
    const ExclusiveUse turn(engine.edited, "ProxyEngine", "editor");
    nb::gil_scoped_release release;
    return engine.edit(remove.data(), remove.shape(0), add.data(), add.shape(0));
}

bool exchange(Engine& engine, Engine& other) {
    const ExclusiveUse turn(engine.edited, "ProxyEngine", "editor");
    const ExclusiveUse their_turn(other.edited, "ProxyEngine", "editor");
    const Use theirs(other);
    return engine.exchange(std::move(other));
}

// A number (T,) for each of some points (T, 3) [m].
nb::object distance(Engine& engine, const Rows& points) {
    const Use turn(engine);
    std::vector<double> all(points.shape(0));
    {
        nb::gil_scoped_release release;
        for (std::size_t i = 0; i < all.size(); ++i)
            all[i] = engine.distance(vfplan::point_at(points.data(), i));
    }
    return array(std::move(all), {points.shape(0)});
}

// OutOfRange -> the exception of Python of the same name, with (message, name, value) as arguments.
void translate(const std::exception_ptr& thrown, void* type) {
    try {
        std::rethrow_exception(thrown);
    } catch (const vfplan::OutOfRange& error) {
        const std::string message = std::string(error.what()).substr(sizeof "vfplan: " - 1);
        const nb::tuple arguments =
            nb::make_tuple(message.c_str(), error.name.c_str(), error.value);
        PyErr_SetObject(static_cast<PyObject*>(type), arguments.ptr());
    }
}

}  // namespace

NB_MODULE(_core, m) {
    m.doc() = "vfplan's native proxy engine and bundle reader";
    const nb::object out_of_range =
        nb::steal(PyErr_NewException("vfplan._core.OutOfRange", PyExc_ValueError, nullptr));
    m.attr("OutOfRange") = out_of_range;
    nb::register_exception_translator(translate, out_of_range.ptr());
    m.attr("__version__") = VFPLAN_VERSION;

    const Parameters usual;
    nb::class_<Parameters>(m, "Parameters", "Table I, SI")
        // No default is an array: a build imports this module where there is no NumPy.
        .def(nb::init<double, double, double, double, double, vfplan::Vec3,
                      std::optional<vfplan::Vec3>, vfplan::Rule, vfplan::Search, int, double>(),
             nb::kw_only(), "contact_radius"_a = usual.contact_radius, "band"_a = usual.band,
             "point_radius"_a = usual.point_radius, "outer_radius"_a = usual.outer_radius,
             "gain"_a = usual.gain, "stiffness"_a, "ignore_axis"_a = nb::none(),
             "rule"_a = usual.rule, "search"_a = usual.search,
             "max_iterations"_a = usual.max_iterations, "max_hip_step"_a = 0.0)
        .def(
            "__init__",
            [](Parameters* self, const Parameters& other, const std::optional<double>& band,
               const std::optional<vfplan::Search>& search) {
                new (self) Parameters(other);
                self->band = band.value_or(other.band);
                self->search = search.value_or(other.search);
            },
            "other"_a, nb::kw_only(), "band"_a = nb::none(), "search"_a = nb::none(),
            "as others, but for the band or the search")
        .def_ro("contact_radius", &Parameters::contact_radius, "r_c [m]")
        .def_ro("band", &Parameters::band, "r2 - r_c = r_c - r1 [m]")
        .def_ro("point_radius", &Parameters::point_radius, "r_v [m]")
        .def_ro("outer_radius", &Parameters::outer_radius, "r3 [m]")
        .def_ro("gain", &Parameters::gain, "xi of eq. (5)")
        .def_ro("max_iterations", &Parameters::max_iterations, "of rule robust, a tick")
        .def_ro("max_hip_step", &Parameters::max_hip_step, "of a HIP, from the last [m]; 0: any")
        .def_ro("rule", &Parameters::rule)
        .def_ro("search", &Parameters::search)
        .def_ro("stiffness", &Parameters::stiffness, "(3,) the diagonal of K [N/m]")
        .def_ro("ignore_axis", &Parameters::ignore_axis,
                "(3,) unit vector along which the fixture is infinite; None in space")
        .def_prop_ro("r1", &Parameters::r1, "r_c - band [m]")
        .def_prop_ro("r2", &Parameters::r2, "r_c + band [m]")
        .def_prop_ro("R", &Parameters::R, "r_c + r_v, where the proxy rests on a point [m]");

    m.def(
        "check",
        [](const Parameters& p, const Rows& points) {
            vfplan::check(p);
            vfplan::check_resolved(p, points.data(), points.shape(0));
        },
        "parameters"_a, "points"_a, "OutOfRange where an engine takes no such parameters");
    m.def(
        "band_for",
        [](const Rows& points, const Parameters& p) {
            nb::gil_scoped_release release;
            const double* xyz = points.data();
            const std::size_t n = points.shape(0);
            if (p.rule != vfplan::Rule::exact) return vfplan::band_for(xyz, n, p);
            return vfplan::exact_band(p, vfplan::largest_of(xyz, n));
        },
        "points"_a, "parameters"_a,
        "the band that a cloud asks for; of rule exact, what roundings need [m]");
    m.def(
        "tick_time_bound",
        [](const Rows& points, const Parameters& p) {
            nb::gil_scoped_release release;
            return vfplan::tick_time_bound(points.data(), points.shape(0), p);
        },
        "points"_a, "parameters"_a, "time that a tick takes at most [s]");
    m.def(
        "coarse_facets",
        [](const Rows& points, const Triples& triangles, const Parameters& p) {
            nb::gil_scoped_release release;
            const vfplan::mesh::Surface s = surface(points, triangles);
            vfplan::mesh::check(s);
            const vfplan::mesh::Mesh mesh(s);
            const vfplan::mesh::SmoothBody body(mesh, p.R());
            return std::make_pair(body.coarse_facets(), body.coarsest_sagitta());
        },
        "points"_a, "triangles"_a, "parameters"_a,
        "facets too coarse to be smoothed, and the sagitta of the coarsest [m]");
    m.def("sampled", &sampled, "points"_a, "triangles"_a, "cover"_a, "longest_side"_a = nb::none(),
          "samples of a mesh, no place of it farther from one [m], and triangles between them; or "
          "those of which no side is longer [m]");
    m.def(
        "use_width", [](int width) { vfplan::use_width(static_cast<vfplan::Width>(width)); },
        "width"_a,
        "for tests, which set 8 again at their end: float64 in a register of all engines, 2, 4 or "
        "8, or the most that there are");
    m.attr("largest_coordinate") = vfplan::largest_coordinate;
    m.attr("finest_band") = vfplan::finest_band;
    m.attr("max_tick_time") = vfplan::max_tick_time;

    nb::class_<Engine> engine(m, "Engine");
    engine
        .def(
            "__init__",
            [](Engine* self, const Rows& points, const Parameters& p) {
                nb::gil_scoped_release release;
                new (self) Engine(points.data(), points.shape(0), p);
            },
            "points"_a, "parameters"_a)
        .def("reset", &reset<Engine>, "hip"_a)
        .def("run", &run<Engine>, "hips"_a)
        .def(
            "set_skin",
            [](Engine& e, const Rows& points, const Triples& triangles) {
                const Use turn(e);
                e.set_skin(surface(points, triangles));
            },
            "points"_a, "triangles"_a, "the mesh of which its points are samples")
        .def("exchange", &exchange, "other"_a)
        .def("edit", &edit, "remove"_a, "add"_a)
        .def("remake",
             [](Engine& e) {
                 const ExclusiveUse turn(e.edited, "ProxyEngine", "editor");
                 nb::gil_scoped_release release;
                 return e.remake();
             })
        .def("distance", &distance, "points"_a)
        .def_prop_ro("band", &Engine::band)
        .def_prop_ro("bytes", &Engine::bytes)
        .def_prop_ro("cells", &Engine::cells);
    bind_shape(m, engine, &strokes, "vertices"_a, "bulges"_a, "stroke"_a, "closed"_a);
    bind_shape(m, engine, &surface, "points"_a, "triangles"_a);

    bind_beside(m);
    bind_bundle(m);
    bind_controller(m);
    bind_extraction(m);
}
