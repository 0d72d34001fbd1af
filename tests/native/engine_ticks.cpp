// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
//   engine_ticks TICKS
//
// First a reset to a HIP that is no number, which must count as none at all; then
// TICKS ticks of every rule over all its scenes: none may allocate, answer with a number that is
// not finite, use up its iterations in rest, or leave the proxy inside. A line a scene; exit status
// 1 names the first failure.
#include <cstdio>
#include <cstdlib>

#include "allocations.hpp"
#include "scenes.hpp"
#include "vfplan/engine.hpp"

namespace {

[[noreturn]] void fail(const std::string& scene, const char* what, long tick, double value) {
    std::printf("%s: %s at tick %ld: %g\n", scene.c_str(), what, tick, value);
    std::exit(1);
}

double nearest(const scenes::Scene& s, const vfplan::Vec3& x) {
    double least = 1e300;
    for (std::size_t i = 0; i < s.points.size(); i += 3) {
        const double dx = s.points[i] - x[0], dy = s.points[i + 1] - x[1];
        const double dz = s.planar ? 0 : s.points[i + 2] - x[2];
        least = std::min(least, dx * dx + dy * dy + dz * dz);
    }
    return std::sqrt(least);
}

void play(const scenes::Scene& scene, vfplan::Rule rule, long ticks) {
    const vfplan::Parameters p = scene.parameters(rule);
    vfplan::Engine engine = scene.engine(p);
    scenes::Path path(scene.points);
    long contacts = 0, inside = 0;
    const long before = allocations;
    bool was_outside = false;
    for (long t = 0; t < ticks; ++t) {
        vfplan::Vec3 hip = path(t);
        const bool bad = t % 997 == 996;
        if (bad) hip[1] = std::nan("");
        const vfplan::Step s = engine.step(hip);
        if (bad != (s.status == vfplan::Status::bad_hip)) fail(scene.name, "bad HIP", t, s.status);
        for (int k = 0; k < 3; ++k)
            if (!std::isfinite(s.proxy[k] + s.normal[k] + s.force[k]))
                fail(scene.name, "not finite", t, s.proxy[k]);
        contacts += s.state == vfplan::State::in_contact;
        const bool is_inside = s.status & vfplan::Status::inside;
        inside += is_inside;
        if (rule != vfplan::Rule::paper && (t % 61 == 0 || is_inside)) {
            const double missing = p.R() - engine.band() - nearest(scene, s.proxy);
            if (!is_inside && missing > 1e-12) fail(scene.name, "inside", t, missing);
            if (is_inside && was_outside) fail(scene.name, "fell inside", t, missing);
        }
        was_outside = was_outside || !is_inside;
    }
    if (allocations != before)
        fail(scene.name, "allocations", ticks, static_cast<double>(allocations - before));
    const char* names[] = {"robust", "paper", "exact"};
    std::printf("%-28s %-6s %ld ticks, %.0f %% in contact, %ld inside, no allocation\n",
                scene.name.c_str(), names[static_cast<int>(rule)], ticks,
                100.0 * static_cast<double>(contacts) / static_cast<double>(ticks), inside);
}

/// After such a reset an engine is as a new one: nothing until the first good HIP, which is its
/// start.
void reset_badly(const scenes::Scene& scene, vfplan::Rule rule, double bad) {
    const vfplan::Parameters p = scene.parameters(rule);
    vfplan::Engine engine = scene.engine(p), fresh = scene.engine(p);
    scenes::Path path(scene.points);
    for (long t = 0; t < 100; ++t) engine.step(path(t));
    engine.reset({{bad, 0, 0}});
    const vfplan::Step nothing = engine.step({{bad, 0, 0}});
    if (nothing.status != vfplan::Status::bad_hip || norm(nothing.force) + norm(nothing.proxy) != 0)
        fail(scene.name, "bad reset", 0, nothing.status);
    for (long t = 100; t < 400; ++t) {
        const vfplan::Vec3 hip = path(t);
        const vfplan::Step a = engine.step(hip), b = fresh.step(hip);
        if (!(a.proxy == b.proxy && a.normal == b.normal && a.force == b.force) ||
            a.status != b.status || a.state != b.state)
            fail(scene.name, "bad reset", t, norm(a.proxy - b.proxy));
    }
}

}  // namespace

int main(int argc, char** argv) {
    const long ticks = argc > 1 ? std::atol(argv[1]) : 100000;
    const auto list = scenes::all(), curves = scenes::curves(), meshes = scenes::meshes();
    const long each =
        ticks / static_cast<long>(2 * list.size() + curves.size() + meshes.size()) + 1;
    const auto judge = [each](const scenes::Scene& scene, vfplan::Rule rule) {
        for (double bad : {std::nan(""), 1.0 / 0.0, 1e200}) reset_badly(scene, rule, bad);
        play(scene, rule, each);
    };
    for (const auto& scene : list)
        for (auto rule : {vfplan::Rule::paper, vfplan::Rule::robust}) judge(scene, rule);
    for (const auto& scene : curves) judge(scene, vfplan::Rule::exact);
    for (const auto& scene : meshes) judge(scene, vfplan::Rule::exact);
}
