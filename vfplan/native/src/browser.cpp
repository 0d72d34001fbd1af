// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The engine and the guide as a WebAssembly module, for pages. It takes flat arrays of float64:
// what ProxyEngine and Guide hand to the core, no more.
//
// A page fills what `array` gives, calls `make`, then `step` for each tick, and reads the answer
// where `step` points to. Arrays that no engine takes end the module with a message on stderr.

#include <variant>

#include "vfplan/engine.hpp"
#include "vfplan/guide.hpp"

namespace {

using vfplan::Vec3;

/// What `rows` are, three float64 each, and what `ties` say of them.
enum class Shape {
    points,        ///< a cloud; ties as of a mesh, where its rows begin with one's corners
    pieces,        ///< lines and arcs; ties: bulge and stroke a row, then `closed` a stroke
    mesh,          ///< its corners; ties: three rows a triangle
    guide_points,  ///< curves that guide; ties as of pieces, without bulges
    guide_pieces   ///< lines and arcs that guide; ties as of pieces
};

using Array = std::vector<double>;

/// Reads an array from its beginning.
struct Reader {
    const double* at;
    double number() { return *at++; }
    Vec3 vector() { return {{number(), number(), number()}}; }
    std::optional<Vec3> axis() {
        const Vec3 v = vector();
        return norm(v) > 0 ? std::optional(v) : std::nullopt;
    }
};

vfplan::Parameters engine_parameters(const Array& array) {
    Reader r{array.data()};
    vfplan::Parameters p;
    p.rule = static_cast<vfplan::Rule>(static_cast<int>(r.number()));
    for (double* x : {&p.contact_radius, &p.band, &p.point_radius, &p.outer_radius, &p.gain})
        *x = r.number();
    p.stiffness = r.vector();
    p.ignore_axis = r.axis();
    p.max_iterations = static_cast<int>(r.number());
    p.max_hip_step = r.number();
    return p;
}

vfplan::GuideParameters guide_parameters(const Array& array) {
    Reader r{array.data()};
    vfplan::GuideParameters p;
    p.radius = r.number();
    p.stiffness = r.number();
    p.ends = static_cast<vfplan::Ends>(static_cast<int>(r.number()));
    p.hold = static_cast<vfplan::Hold>(static_cast<int>(r.number()));
    p.cut_bends = r.number() != 0;
    p.ignore_axis = r.axis();
    for (double* x : {&p.lead_force, &p.lead_speed, &p.period}) *x = r.number();
    return p;
}

/// The strokes of rows and ties.
std::vector<vfplan::Stroke> strokes(const Array& rows, const Array& ties) {
    const std::size_t n = rows.size() / 3;
    Array bulges(n), stroke(n);
    for (std::size_t i = 0; i < n; ++i) {
        bulges[i] = ties[2 * i];
        stroke[i] = ties[2 * i + 1];
    }
    return vfplan::drawn_strokes(rows.data(), n, bulges, stroke, ties.data() + 2 * n,
                                 ties.size() - 2 * n);
}

/// An engine or a guide, and its last answer: proxy, normal, force, state, status.
struct Rendered {
    std::variant<vfplan::Engine, vfplan::Guide> what;
    double answer[11] = {};
};

vfplan::Guide guide_of(Shape shape, const Array& parameters, const Array& rows, const Array& ties) {
    const vfplan::GuideParameters p = guide_parameters(parameters);
    const std::vector<vfplan::Stroke> all = strokes(rows, ties);
    if (shape == Shape::guide_pieces) return {all, p};
    std::vector<std::size_t> counts;
    std::vector<bool> closed;
    for (const vfplan::Stroke& s : all) {
        counts.push_back(s.bulges.size());
        closed.push_back(s.closed);
    }
    return {rows.data(), counts, closed, p};
}

vfplan::Engine engine_of(Shape shape, const Array& parameters, const Array& rows,
                         const Array& ties) {
    const vfplan::Parameters p = engine_parameters(parameters);
    const std::size_t n = rows.size() / 3;
    if (shape == Shape::pieces) return {strokes(rows, ties), p};
    const std::vector<std::int32_t> triangles(ties.begin(), ties.end());
    const vfplan::mesh::Surface surface{rows.data(), n, triangles.data(), triangles.size() / 3};
    if (shape == Shape::mesh) return {surface, p};
    vfplan::Engine engine(rows.data(), n, p);
    if (surface.k > 0) engine.set_skin(surface);
    return engine;
}

}  // namespace

#define EXPORTED(name) extern "C" __attribute__((export_name(#name)))

/// Room for n float64, to be filled by the page at `data` and freed by it.
EXPORTED(array) Array* array(std::size_t n) { return new Array(n); }
EXPORTED(data) double* data(Array* array) { return array->data(); }
EXPORTED(free_array) void free_array(Array* array) { delete array; }

EXPORTED(make)
Rendered* make(int shape_number, const Array* parameters, const Array* rows, const Array* ties) {
    const auto shape = static_cast<Shape>(shape_number);
    if (shape == Shape::guide_points || shape == Shape::guide_pieces)
        return new Rendered{guide_of(shape, *parameters, *rows, *ties)};
    return new Rendered{engine_of(shape, *parameters, *rows, *ties)};
}

EXPORTED(free_rendered) void free_rendered(Rendered* rendered) { delete rendered; }

EXPORTED(reset) void reset(Rendered* rendered, double x, double y, double z) {
    std::visit([&](auto& it) { it.reset({{x, y, z}}); }, rendered->what);
}

/// One tick. A guide has no normal, and its state is 1 where it has hold of the tip.
EXPORTED(step) const double* step(Rendered* rendered, double x, double y, double z) {
    double* out = rendered->answer;
    const auto tick = [&](auto& it) {
        const auto s = it.step({{x, y, z}});
        Vec3 normal;
        double state;
        if constexpr (requires { s.held; })
            state = s.held;
        else
            std::tie(normal, state) = std::pair(s.normal, int(s.state));
        for (const Vec3& v : {s.proxy, normal, s.force}) out = std::copy_n(v.c, 3, out);
        *out++ = state;
        *out = s.status;
    };
    std::visit(tick, rendered->what);
    return rendered->answer;
}
