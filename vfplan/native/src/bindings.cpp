// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The Python face of the native engine: the only file that includes nanobind. No logic here.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <atomic>
#include <chrono>
#include <stdexcept>

#include "vfplan/engine.hpp"
#include "vfplan/version.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Rows = nb::ndarray<const double, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Row = nb::ndarray<const double, nb::shape<3>, nb::c_contig, nb::device::cpu>;

template <class T>
nb::ndarray<nb::numpy, T> array(std::size_t rows, std::size_t columns) {
    T* data = new T[rows * columns + 1];
    nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<T*>(p); });
    const std::size_t shape[2] = {rows, columns};
    return nb::ndarray<nb::numpy, T>(data, columns > 1 ? 2 : 1, shape, owner);
}

// An engine keeps its proxy from tick to tick: a call while another is under way is refused.
struct Engine : vfplan::Engine {
    using vfplan::Engine::Engine;
    std::atomic_flag busy = ATOMIC_FLAG_INIT;
};

class Turn {
  public:
    explicit Turn(Engine& engine) : engine_(engine) {
        if (engine_.busy.test_and_set(std::memory_order_acquire))
            throw std::runtime_error(
                "this ProxyEngine is in use by another thread: one engine serves one thread, "
                "make one for each");
    }
    ~Turn() { engine_.busy.clear(std::memory_order_release); }
    Turn(const Turn&) = delete;
    Turn& operator=(const Turn&) = delete;

  private:
    Engine& engine_;
};

vfplan::Vec3 vec(const Row& r) { return {{r(0), r(1), r(2)}}; }

nb::tuple step(Engine& engine, const Row& hip) {
    const Turn turn(engine);
    const vfplan::Step s = engine.step(vec(hip));
    auto rows = array<double>(3, 3);
    const vfplan::Vec3* from[] = {&s.proxy, &s.normal, &s.force};
    for (int i = 0; i < 3; ++i) std::memcpy(rows.data() + 3 * i, from[i]->c, sizeof from[i]->c);
    return nb::make_tuple(rows, static_cast<int>(s.state), static_cast<int>(s.status));
}

// Proxy, normal, force (T, 3), state, status (T,), and the time of each tick [s] when asked for.
nb::tuple run(Engine& engine, const Rows& hips, bool timed) {
    const Turn turn(engine);
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
    m.doc() = "vfplan's native proxy engine";
    m.attr("__version__") = VFPLAN_VERSION;
    m.def(
        "simd_width", [] { return static_cast<int>(vfplan::widest()); },
        "float64 in a register of the processor at hand, as far as the engine uses them");

    nb::enum_<vfplan::Rule>(m, "Rule")
        .value("robust", vfplan::Rule::robust)
        .value("paper", vfplan::Rule::paper);
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
            "reset",
            [](Engine& e, const Row& hip) {
                const Turn turn(e);
                e.reset(vec(hip));
            },
            "hip"_a)
        .def("step", &step, "hip"_a)
        .def("run", &run, "hips"_a, "timed"_a = false)
        .def("distance", &distance, "points"_a)
        .def_prop_ro("bytes", &Engine::bytes)
        .def_prop_ro("cells", &Engine::cells)
        .def_prop_ro("planar", &Engine::planar);
}
