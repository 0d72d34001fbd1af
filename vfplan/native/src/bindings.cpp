// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The Python face of the native engine. No logic here.
#include <chrono>

#include "numpy.hpp"
#include "vfplan/engine.hpp"
#include "vfplan/version.hpp"
#include "vfplan/work.hpp"

void bind_governor(nb::module_& m);
void bind_guide(nb::module_& m);
void bind_bundle(nb::module_& m);

namespace {

// An engine keeps its proxy from tick to tick: a call while another is under way is refused.
struct Engine : vfplan::Engine {
    using vfplan::Engine::Engine;
    std::atomic_flag busy = ATOMIC_FLAG_INIT;
};

struct Serving : Turn {
    explicit Serving(Engine& engine) : Turn(engine.busy, "ProxyEngine", "engine") {}
};

using Numbers = nb::ndarray<const double, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using Ids = nb::ndarray<const std::int32_t, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using Flags = nb::ndarray<const std::uint8_t, nb::shape<-1>, nb::c_contig, nb::device::cpu>;

std::vector<vfplan::Stroke> strokes(const Rows& vertices, const Numbers& bulges, const Ids& stroke,
                                    const Flags& closed) {
    if (bulges.shape(0) != vertices.shape(0) || stroke.shape(0) != vertices.shape(0))
        throw std::invalid_argument("vfplan: a bulge and a stroke a vertex");
    std::vector<vfplan::Stroke> all(closed.shape(0));
    for (std::size_t s = 0; s < all.size(); ++s) all[s].closed = closed(s) != 0;
    for (std::size_t i = 0; i < vertices.shape(0); ++i) {
        vfplan::Stroke& s = all.at(static_cast<std::size_t>(stroke(i)));
        s.vertices.insert(s.vertices.end(), {vertices(i, 0), vertices(i, 1), vertices(i, 2)});
        s.bulges.push_back(bulges(i));
    }
    return all;
}

nb::tuple step(Engine& engine, const Row& hip) {
    const Serving turn(engine);
    const vfplan::Step s = engine.step(vec(hip));
    auto rows = array<double>(3, 3);
    const vfplan::Vec3* from[] = {&s.proxy, &s.normal, &s.force};
    for (int i = 0; i < 3; ++i) std::memcpy(rows.data() + 3 * i, from[i]->c, sizeof from[i]->c);
    return nb::make_tuple(rows, static_cast<int>(s.state), static_cast<int>(s.status));
}

// Proxy, normal, force (T, 3), state, status (T,), and the time of each tick [s] when asked for.
nb::tuple run(Engine& engine, const Rows& hips, bool timed) {
    const Serving turn(engine);
    const std::size_t n = hips.shape(0);
    auto proxy = array<double>(n, 3), normal = array<double>(n, 3), force = array<double>(n, 3);
    auto state = array<std::int8_t>(n, 1);
    auto status = array<std::uint8_t>(n, 1);
    auto seconds = array<double>(timed ? n : 0, 1);
    double *p = proxy.data(), *v = normal.data(), *f = force.data(), *t = seconds.data();
    std::int8_t* a = state.data();
    std::uint8_t* b = status.data();
    const double* h = hips.data();
    {
        nb::gil_scoped_release release;
        using clock = std::chrono::steady_clock;
        for (std::size_t i = 0; i < n; ++i) {
            clock::time_point before;
            if (timed) before = clock::now();
            const vfplan::Step s = engine.step({{h[3 * i], h[3 * i + 1], h[3 * i + 2]}});
            if (timed) t[i] = std::chrono::duration<double>(clock::now() - before).count();
            std::memcpy(p + 3 * i, s.proxy.c, sizeof s.proxy.c);
            std::memcpy(v + 3 * i, s.normal.c, sizeof s.normal.c);
            std::memcpy(f + 3 * i, s.force.c, sizeof s.force.c);
            a[i] = static_cast<std::int8_t>(s.state);
            b[i] = s.status;
        }
    }
    return nb::make_tuple(proxy, normal, force, state, status, seconds);
}

nb::object distance(const Engine& engine, const Rows& points) {
    const std::size_t n = points.shape(0);
    auto out = array<double>(n, 1);
    double* d = out.data();
    const double* x = points.data();
    {
        nb::gil_scoped_release release;
        for (std::size_t i = 0; i < n; ++i)
            d[i] = engine.distance({{x[3 * i], x[3 * i + 1], x[3 * i + 2]}});
    }
    return nb::cast(out);
}

}  // namespace

NB_MODULE(_core, m) {
    m.doc() = "vfplan's native proxy engine and bundle reader";
    m.attr("__version__") = VFPLAN_VERSION;
    m.def(
        "simd_width", [] { return static_cast<int>(vfplan::widest()); },
        "float64 in a register of the processor at hand, as far as the engine uses them");

    nb::enum_<vfplan::Rule>(m, "Rule")
        .value("robust", vfplan::Rule::robust)
        .value("paper", vfplan::Rule::paper)
        .value("exact", vfplan::Rule::exact);
    nb::enum_<vfplan::Search>(m, "Search")
        .value("auto", vfplan::Search::automatic)
        .value("grid", vfplan::Search::grid)
        .value("brute", vfplan::Search::brute);

    nb::class_<vfplan::Parameters>(m, "Parameters", "Table I, SI")
        .def(nb::init<>())
        .def_rw("contact_radius", &vfplan::Parameters::contact_radius)
        .def_rw("band", &vfplan::Parameters::band)
        .def_rw("point_radius", &vfplan::Parameters::point_radius)
        .def_rw("outer_radius", &vfplan::Parameters::outer_radius)
        .def_rw("gain", &vfplan::Parameters::gain)
        .def_rw("rule", &vfplan::Parameters::rule)
        .def_rw("search", &vfplan::Parameters::search)
        .def_rw("max_iterations", &vfplan::Parameters::max_iterations)
        .def("set_stiffness", [](vfplan::Parameters& p, const Row& k) { p.stiffness = vec(k); })
        .def("set_ignore_axis",
             [](vfplan::Parameters& p, const Row& a) { p.ignore_axis = vec(a); });

    m.def(
        "tick_work",
        [](const Rows& points, const vfplan::Parameters& p) {
            nb::gil_scoped_release release;
            return vfplan::tick_work(points.data(), points.shape(0), p);
        },
        "points"_a, "parameters"_a, "time that a tick takes at most [s]");
    m.attr("most_tick_work") = vfplan::most_tick_work;

    nb::class_<Engine>(m, "Engine")
        .def(
            "__init__",
            [](Engine* self, const Rows& points, const vfplan::Parameters& p, int width) {
                nb::gil_scoped_release release;
                new (self)
                    Engine(points.data(), points.shape(0), p, static_cast<vfplan::Width>(width));
            },
            "points"_a, "parameters"_a, "width"_a = 0)
        .def(
            "__init__",
            [](Engine* self, const Rows& vertices, const Numbers& bulges, const Ids& stroke,
               const Flags& closed, const vfplan::Parameters& p) {
                new (self) Engine(strokes(vertices, bulges, stroke, closed), p);
            },
            "vertices"_a, "bulges"_a, "stroke"_a, "closed"_a, "parameters"_a)
        .def(
            "reset",
            [](Engine& e, const Row& hip) {
                const Serving turn(e);
                e.reset(vec(hip));
            },
            "hip"_a)
        .def("step", &step, "hip"_a)
        .def("run", &run, "hips"_a, "timed"_a = false)
        .def("distance", &distance, "points"_a)
        .def_prop_ro("bytes", &Engine::bytes)
        .def_prop_ro("cells", &Engine::cells)
        .def_prop_ro("planar", &Engine::planar);

    bind_governor(m);
    bind_guide(m);
    bind_bundle(m);
}
