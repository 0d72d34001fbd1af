// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
//   engine_bits TICKS [WIDTH]
//
// A line a scene: its name, a sum over the bits that went in, a sum over the bits that came out,
// and the mean size of the forces, which tells how large a difference is. The scenes are all rules
// over all their fixtures, guides, governors, moving fixtures, and engines that are exchanged or
// edited under the hand, each over TICKS ticks. WIDTH is the number of float64 in a register (2, 4
// or 8; without it, the most that the processor has).
//
// Every build prints the same: each compiler, width and processor, as long as the compiler does not
// contract a*b+c (-ffp-contract=off). Sines and cosines differ between C libraries, so inputs made
// with them are rounded to a nanometre first, and a guide's arc length is printed to nine digits.
// tests/data/oracle/engine.txt holds what the program printed for commit 2dd7600.
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <utility>

#include "guide_shapes.hpp"
#include "scenes.hpp"
#include "vfplan/engine.hpp"
#include "vfplan/governor.hpp"
#include "vfplan/guide.hpp"
#include "vfplan/moving.hpp"

namespace {

using vfplan::Vec3;

/// FNV-1a over words of 64 bits, whose upper half is folded down, and the mean size of a force.
struct Sum {
    std::uint64_t value = 14695981039346656037ull;
    double force = 0;
    void add(std::uint64_t bits) {
        value = (value ^ bits) * 1099511628211ull;
        value ^= value >> 32;
    }
    void add(double x) { add(std::bit_cast<std::uint64_t>(x)); }
    void add(const Vec3& x) {
        for (double c : x.c) add(c);
    }
    void add(const vfplan::Step& s) {
        for (const Vec3& x : {s.proxy, s.normal, s.force}) add(x);
        add(static_cast<std::uint64_t>(s.status) << 8 | static_cast<std::uint8_t>(s.state));
        force += norm(s.force);
    }
};

void print(const std::string& name, const Sum& in, const Sum& out, long ticks,
           const std::string& more = "") {
    std::printf("%s: %016llx %016llx, mean force %.9f N%s\n", name.c_str(),
                static_cast<unsigned long long>(in.value),
                static_cast<unsigned long long>(out.value), out.force / double(ticks),
                more.c_str());
}

double snapped(double x) { return std::nearbyint(x * 0x1p30) * 0x1p-30; }
Vec3 snapped(const Vec3& x) { return {{snapped(x[0]), snapped(x[1]), snapped(x[2])}}; }

std::vector<scenes::Scene> clouds() {
    std::vector<scenes::Scene> all = scenes::all();
    for (scenes::Scene& scene : all)
        for (double& c : scene.points) c = snapped(c);
    return all;
}

void play(const scenes::Scene& scene, vfplan::Rule rule, long ticks) {
    vfplan::Engine engine = scene.engine(scene.parameters(rule));
    scenes::Path path(scene.points);
    Sum in, out;
    for (long t = 0; t < ticks; ++t) {
        const Vec3 hip = path(t);
        in.add(hip);
        out.add(engine.step(hip));
    }
    print(scene.name + ", rule " + std::to_string(static_cast<int>(rule)), in, out, ticks);
}

/// Holds at once and stops at the ends, or holds on entry, is open at the ends and leads.
void guide(const guide_shapes::Shape& shape, bool leads, long ticks) {
    std::vector<double> xyz;
    for (int i = 0; i < shape.points; ++i) {
        const Vec3 x = shape.curve(double(i) / (shape.closed ? shape.points : shape.points - 1));
        for (double c : x.c) xyz.push_back(snapped(c));
    }
    vfplan::GuideParameters p;
    p.radius = shape.radius;
    p.cut_bends = true;
    if (shape.planar) p.ignore_axis = Vec3{{0, 0, 1}};
    if (leads) {
        p.ends = vfplan::Ends::open;
        p.hold = vfplan::Hold::on_entry;
        p.lead_force = 0.5;
    }
    vfplan::Guide guide = shape.arcs ? vfplan::Guide({guide_shapes::meander}, p)
                                     : vfplan::Guide(xyz.data(), xyz.size() / 3, shape.closed, p);
    guide_shapes::Hand hand(shape, 7);
    Sum in, out;
    double arcs = 0;
    for (long t = 0; t < ticks; ++t) {
        const Vec3 hip = snapped(hand(t));
        const vfplan::GuideStep s = guide.step(hip);
        in.add(hip);
        out.add(s.proxy);
        out.add(s.force);
        out.force += norm(s.force);
        out.add(s.lateral);
        out.add(std::uint64_t{s.strand} << 16 | std::uint64_t{s.held} << 8 | s.status);
        arcs += s.arc;
    }
    char mean[48];
    std::snprintf(mean, sizeof mean, ", mean arc %.9f m", arcs / double(ticks));
    print(std::string("guide, ") + shape.name + (leads ? ", leads" : ""), in, out, ticks, mean);
}

/// Forces that creep, leap, turn round and are no numbers; an arm that moves, and jumps at times.
void governor(bool torques, long ticks) {
    constexpr int joints = 7;
    vfplan::GovernorLimits limits;
    limits.force_step = 0.4;
    if (torques)
        for (int j = 0; j < joints; ++j) {
            limits.torque_step[j] = 0.3;
            limits.torque_max[j] = j < 4 ? 9 : 6;
        }
    vfplan::Governor governor(limits);
    scenes::Random random{5};
    Vec3 wish;
    double jacobian[3 * joints] = {}, drift[3 * joints] = {};
    Sum in, out;
    for (long t = 0; t < ticks; ++t) {
        const long kind = t % 400;
        for (int k = 0; k < 3; ++k) {
            if (kind < 300) wish[k] += random(-0.08, 0.08);
            if (kind == 300) wish[k] = random(-25, 25);
            if (kind == 340) wish[k] = 0;
            if (kind == 370) wish[k] = -wish[k] + random(-12, 12);
        }
        for (int i = 0; i < 3 * joints; ++i) {
            if (t % 3000 == 0) jacobian[i] = random(-0.8, 0.8);
            if (t % 500 == 0) drift[i] = random(-1e-3, 1e-3);
            jacobian[i] = std::clamp(jacobian[i] + drift[i], -0.8, 0.8);
        }
        Vec3 force = wish;
        if (t % 997 == 996) force[static_cast<std::size_t>(t % 3)] = t % 2 ? std::nan("") : -1e308;
        double sent[3 * joints];
        std::copy_n(jacobian, 3 * joints, sent);
        if (t % 1499 == 1498) sent[t % 21] = 1.0 / 0.0;
        const vfplan::Governed g =
            torques ? governor.step(force, sent, joints) : governor.step(force);
        in.add(wish);
        for (double j : jacobian) in.add(j);
        out.add(g.force);
        out.force += norm(g.force);
        out.add(g.held_back);
        out.add(std::uint64_t{g.status});
        for (int j = 0; j < joints; ++j) out.add(governor.torque()[j]);
        out.add(governor.energy_given());
        out.add(governor.energy_stored());
    }
    print(torques ? "governor, torques" : "governor, forces", in, out, ticks);
}

/// A fixture whose tracker sends a pose every 23 ticks, 8 ticks late: it wanders, jumps, sends one
/// that is not rigid, or falls silent for 200 ticks.
template <class Step>
void moving(const std::string& name, const scenes::Points& points, long ticks, Step&& step) {
    vfplan::MovingFrame frame({0.1, 0.25, 1, {{0, 0, 1e-3}}});
    scenes::Path path(points);
    scenes::Random random{11};
    vfplan::Pose pose;
    Sum in, out;
    for (long t = 0; t < ticks; ++t) {
        if (t % 23 == 0 && t % 1000 < 800) {
            const double far = t % 1610 == 0 ? 0.02 : 2e-3;
            for (int k = 0; k < 3; ++k) {
                pose.place[k] += random(-far, far);
                pose.v[k] += random(-0.01, 0.01);
            }
            const double size = std::sqrt(pose.w * pose.w + dot(pose.v, pose.v));
            pose.w /= size;
            pose.v = (1 / size) * pose.v;
            vfplan::Pose sent = pose;
            if (t % 69 == 0) sent.w *= 1.01;  // not rigid
            const double stamp = 1e-3 * double(t - 8);
            frame.pose(stamp, sent);
            in.add(stamp);
            in.add(sent.place);
            in.add(sent.w);
            in.add(sent.v);
        }
        const Vec3 hip = path(t);
        in.add(hip);
        step(frame, 1e-3 * double(t), hip, out);
        out.add(frame.now().place);
        out.add(frame.now().w);
        out.add(frame.now().v);
    }
    print("moving, " + name, in, out, ticks);
}

void moving_engine(const scenes::Scene& scene, vfplan::Rule rule, long ticks) {
    vfplan::Engine engine = scene.engine(scene.parameters(rule));
    moving(scene.name + ", rule " + std::to_string(static_cast<int>(rule)), scene.points, ticks,
           [&](vfplan::MovingFrame& frame, double t, const Vec3& hip, Sum& out) {
               out.add(frame.step(engine, t, hip));
           });
}

void moving_guide(long ticks) {
    vfplan::GuideParameters p;
    p.ignore_axis = Vec3{{0, 0, 1}};
    p.radius = 2e-3;
    vfplan::Guide guide({guide_shapes::meander}, p);
    scenes::Points points;
    for (std::size_t i = 0; i < 6; ++i)
        for (std::size_t k = 0; k < 3; ++k)
            points.push_back(guide_shapes::meander.vertices[3 * i + k]);
    moving("guide", points, ticks,
           [&](vfplan::MovingFrame& frame, double t, const Vec3& hip, Sum& out) {
               const vfplan::GuideStep s = frame.step(guide, t, hip);
               out.add(s.proxy);
               out.add(s.force);
               out.force += norm(s.force);
               out.add(std::uint64_t{s.held} << 8 | s.status);
           });
}

/// Every 170 ticks the engine is exchanged for one of another rule, radius, stiffness or fixture.
void exchange(const char* name, const std::vector<scenes::Scene>& fixtures, long ticks) {
    const auto made = [&](long k) {
        const scenes::Scene& scene = fixtures[static_cast<std::size_t>(k) % fixtures.size()];
        const bool drawn = !scene.strokes.empty() || !scene.triangles.empty();
        vfplan::Parameters p = scene.parameters(drawn        ? vfplan::Rule::exact
                                                : k % 5 == 4 ? vfplan::Rule::paper
                                                             : vfplan::Rule::robust);
        p.contact_radius = 4e-3 + 1e-3 * double(k % 3);
        for (double& c : p.stiffness.c) c = 500.0 * double(1 + k % 4);
        return scene.engine(p);
    };
    vfplan::Engine engine = made(0);
    scenes::Path path(fixtures[0].points);
    Sum in, out;
    for (long t = 0; t < ticks; ++t) {
        if (t % 170 == 169) engine.exchange(made(t / 170 + 1));
        const Vec3 hip = path(t);
        in.add(hip);
        out.add(engine.step(hip));
        out.add(engine.changes_applied());
    }
    print(name, in, out, ticks);
}

/// Every 5 ticks eight points of a sheet are taken away and those of eight ticks ago are put back.
void edit(long ticks) {
    const scenes::Points sheet = scenes::sheet(81, 5e-4);
    vfplan::Parameters p;
    p.max_hip_step = 0;
    p.band = 2e-5;
    p.search = vfplan::Search::editable;
    const auto size = static_cast<std::uint32_t>(sheet.size() / 3);
    vfplan::Engine engine(sheet.data(), size, p);
    std::vector<std::uint32_t> number(size);  // of the point at each place
    for (std::uint32_t i = 0; i < size; ++i) number[i] = i;
    scenes::Path path(sheet);
    scenes::Random random{3};
    std::uint32_t next = size;
    std::vector<std::uint32_t> empty;  // places whose point is gone
    Sum in, out;
    for (long t = 0; t < ticks; ++t) {
        if (t % 5 == 4) {
            std::vector<std::uint32_t> gone, places;
            while (places.size() < 8) {
                const auto place = static_cast<std::uint32_t>(random(0, size));
                if (number[place] == ~0u) continue;
                gone.push_back(number[place]);
                number[place] = ~0u;
                places.push_back(place);
            }
            std::vector<double> back;
            for (const std::uint32_t place : empty) {
                number[place] = next++;
                for (std::size_t k = 0; k < 3; ++k) back.push_back(sheet[3 * place + k]);
                in.add(std::uint64_t{place});
            }
            engine.edit(gone.data(), gone.size(), back.data(), empty.size());
            empty = places;
        }
        const Vec3 hip = path(t);
        in.add(hip);
        out.add(engine.step(hip));
        out.add(engine.changes_applied());
    }
    print("edit", in, out, ticks);
}

}  // namespace

int main(int argc, char** argv) {
    const long ticks = argc > 1 ? std::atol(argv[1]) : 1000;
    if (argc > 2 && std::atoi(argv[2]) > 0)
        vfplan::use_width(static_cast<vfplan::Width>(std::atoi(argv[2])));
    const auto clouds = ::clouds(), curves = scenes::curves(), meshes = scenes::meshes();
    for (const auto& scene : clouds)
        for (auto rule : {vfplan::Rule::paper, vfplan::Rule::robust}) play(scene, rule, ticks);
    for (const auto& scene : curves) play(scene, vfplan::Rule::exact, ticks);
    for (const auto& scene : meshes) play(scene, vfplan::Rule::exact, ticks);
    for (const auto& shape : guide_shapes::shapes)
        for (const bool leads : {false, true}) guide(shape, leads, ticks);
    for (const bool torques : {false, true}) governor(torques, ticks);
    moving_engine(clouds[0], vfplan::Rule::paper, ticks);
    moving_engine(clouds[0], vfplan::Rule::robust, ticks);
    moving_engine(clouds[5], vfplan::Rule::robust, ticks);
    moving_engine(curves[2], vfplan::Rule::exact, ticks);
    moving_engine(meshes[1], vfplan::Rule::exact, ticks);
    moving_guide(ticks);
    exchange("exchange, clouds and curves",
             {clouds[1], curves[0], clouds[7], clouds[5], curves[2], clouds[9]}, ticks);
    exchange("exchange, meshes", {meshes[0], clouds[0], meshes[2]}, ticks);
    edit(ticks);
}
