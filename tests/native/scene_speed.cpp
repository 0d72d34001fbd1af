// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// What a tick costs on the scenes that scene_speed.py writes: of nanoflann's peer with the paper's
// rule, of the engine with the same rule, and of the engine with its default rule.
//
//   scene_speed ROUNDS FILE ...
//
// A file holds, as float64: the numbers of points and of ticks, 1 where z is ignored, contact
// radius, outer radius, the paper's band and the default rule's, points, HIPs. A line is printed
// for each file: microseconds of the peer and of rule paper, mean over the path in the fastest
// round; median and worst tick of rule robust, of each tick the least of all rounds.
#include <chrono>
#include <cstdio>
#include <ctime>

#define main peer_main
#include "../../samples/peer/nanoflann_peer.cpp"
#undef main
#include "vfplan/engine.hpp"

namespace {

double cpu_seconds() {
    timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

std::vector<double> read_file(const char* name) {
    std::ifstream file(name, std::ios::binary | std::ios::ate);
    std::vector<double> all(static_cast<std::size_t>(file.tellg()) / sizeof(double));
    file.seekg(0);
    file.read(reinterpret_cast<char*>(all.data()),
              static_cast<std::streamsize>(all.size() * sizeof(double)));
    return all;
}

/// Mean time of a tick over the path [us].
template <class Tick>
double mean_time(const double* hips, std::size_t ticks, Tick&& tick) {
    const double before = cpu_seconds();
    for (std::size_t i = 0; i < ticks; ++i) tick(hips + 3 * i);
    return 1e6 * (cpu_seconds() - before) / static_cast<double>(ticks);
}

void measure(const char* name, int rounds) {
    const std::vector<double> file = read_file(name);
    const auto n = static_cast<std::size_t>(file[0]), ticks = static_cast<std::size_t>(file[1]);
    const double* points = file.data() + 7;
    const double* hips = points + 3 * n;

    vfplan::Parameters p;
    p.contact_radius = file[3];
    p.outer_radius = file[4];
    p.band = file[5];
    p.rule = vfplan::Rule::paper;
    if (file[2] == 1) p.ignore_axis = vfplan::Vec3{{0, 0, 1}};
    vfplan::Engine paper(points, n, p);
    p.rule = vfplan::Rule::robust;
    p.band = file[6];
    vfplan::Engine robust(points, n, p);

    Cloud cloud;
    for (std::size_t i = 0; i < n; ++i)
        cloud.points.push_back(
            {points[3 * i], points[3 * i + 1], file[2] == 1 ? 0 : points[3 * i + 2]});
    const std::map<std::string, double> settings{{"contact_radius", file[3]},
                                                 {"outer_radius", file[4]},
                                                 {"band", file[5]},
                                                 {"point_radius", 0},
                                                 {"gain", 1}};
    PaperRule peer(cloud, settings);

    double peer_time = 1e300, paper_time = 1e300;
    std::vector<double> robust_times(ticks, 1e300);
    for (int round = 0; round < rounds; ++round) {
        Vec proxy{hips[0], hips[1], file[2] == 1 ? 0 : hips[2]};
        peer_time = std::min(peer_time, mean_time(hips, ticks, [&](const double* h) {
                                 peer.step(proxy, {h[0], h[1], file[2] == 1 ? 0 : h[2]});
                             }));
        paper.reset({{hips[0], hips[1], hips[2]}});
        paper_time = std::min(paper_time, mean_time(hips, ticks, [&](const double* h) {
                                  paper.step({{h[0], h[1], h[2]}});
                              }));
        robust.reset({{hips[0], hips[1], hips[2]}});
        for (std::size_t i = 0; i < ticks; ++i) {
            const auto before = std::chrono::steady_clock::now();
            robust.step({{hips[3 * i], hips[3 * i + 1], hips[3 * i + 2]}});
            const std::chrono::duration<double, std::micro> taken =
                std::chrono::steady_clock::now() - before;
            robust_times[i] = std::min(robust_times[i], taken.count());
        }
    }
    std::sort(robust_times.begin(), robust_times.end());
    std::printf("%.17g %.17g %.17g %.17g\n", peer_time, paper_time, robust_times[ticks / 2],
                robust_times.back());
    std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
    for (int i = 2; i < argc; ++i) measure(argv[i], std::atoi(argv[1]));
}
