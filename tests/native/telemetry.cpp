// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Publishes known ticks: telemetry PORT TICKS CAPACITY PAUSE_US. Tick k has t = k / 1000 and every
// component v of every vector = (k + 1) / (v + 3). Says what was dropped and what a publish cost.
#include "vfplan/telemetry.hpp"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <thread>

int main(int argc, char** argv) {
    if (argc != 5) return 2;
    const auto number = [argv](int k) { return std::strtol(argv[k], nullptr, 10); };
    std::vector<double> ns;
    std::uint64_t dropped = 0, unsent = 0;
    {
        vfplan::Telemetry telemetry(std::uint16_t(number(1)), "127.0.0.1", std::size_t(number(3)));
        auto due = std::chrono::steady_clock::now();
        for (long k = 0; k < number(2); ++k) {
            vfplan::Vec3 v[4];
            for (int i = 0; i < 12; ++i) v[i / 3][i % 3] = double(k + 1) / double(i + 3);
            const vfplan::Step step{v[1], v[2], v[3], vfplan::State(k % 4 - 1),
                                    std::uint8_t(k % 8)};
            const auto before = std::chrono::steady_clock::now();
            telemetry.publish(double(k) / 1000, v[0], step);
            const std::chrono::duration<double, std::nano> took =
                std::chrono::steady_clock::now() - before;
            ns.push_back(took.count());
            due += std::chrono::microseconds(number(4));
            if (number(4) > 0) std::this_thread::sleep_until(due);
        }
        dropped = telemetry.dropped();
        unsent = telemetry.unsent();
    }
    std::sort(ns.begin(), ns.end());
    std::printf("dropped %llu unsent %llu publish_ns_median %.0f p999 %.0f\n",
                static_cast<unsigned long long>(dropped), static_cast<unsigned long long>(unsent),
                ns[ns.size() / 2], ns[std::size_t(0.999 * double(ns.size()))]);
}
