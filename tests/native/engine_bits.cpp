// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
//   engine_bits TICKS
//
// TICKS ticks of every rule over all its scenes. A line a scene: a sum over the bits that went in,
// and one over the bits that came out. Wherever it is built, it prints the same.
#include <bit>
#include <cstdio>
#include <cstdlib>

#include "scenes.hpp"
#include "vfplan/engine.hpp"

namespace {

/// FNV-1a.
struct Sum {
    std::uint64_t value = 14695981039346656037ull;
    void add(std::uint64_t bits) { value = (value ^ bits) * 1099511628211ull; }
    void add(const vfplan::Vec3& x) {
        for (double c : x.c) add(std::bit_cast<std::uint64_t>(c));
    }
};

/// To a nanometre: sine and cosine differ between C libraries.
double snapped(double x) { return std::nearbyint(x * 0x1p30) * 0x1p-30; }

void play(const scenes::Scene& scene, vfplan::Rule rule, long ticks) {
    vfplan::Engine engine = scene.engine(scene.parameters(rule));
    scenes::Path path(scene.points);
    Sum in, out;
    for (long t = 0; t < ticks; ++t) {
        const vfplan::Vec3 hip = path(t);
        const vfplan::Step s = engine.step(hip);
        in.add(hip);
        for (const vfplan::Vec3& x : {s.proxy, s.normal, s.force}) out.add(x);
        out.add(static_cast<std::uint64_t>(s.status) << 8 | static_cast<std::uint8_t>(s.state));
    }
    std::printf("%s, rule %d: %016llx %016llx\n", scene.name.c_str(), static_cast<int>(rule),
                static_cast<unsigned long long>(in.value),
                static_cast<unsigned long long>(out.value));
}

}  // namespace

int main(int argc, char** argv) {
    const long ticks = argc > 1 ? std::atol(argv[1]) : 1000;
    for (scenes::Scene& scene : scenes::all()) {
        for (double& c : scene.points) c = snapped(c);
        for (auto rule : {vfplan::Rule::paper, vfplan::Rule::robust}) play(scene, rule, ticks);
    }
    for (const auto& scene : scenes::curves()) play(scene, vfplan::Rule::exact, ticks);
    for (const auto& scene : scenes::meshes()) play(scene, vfplan::Rule::exact, ticks);
}
