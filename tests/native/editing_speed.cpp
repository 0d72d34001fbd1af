// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
//   editing_speed [--brief]
//
// What editing a cloud costs, in processor time, which other programs do not disturb. First, for
// clouds of several sizes, an edit of 64 points: handed over and taken up, or the engine made anew.
// Then 52 edits a tick, half of them points that go and half that come, for 20 s of a loop of
// 2 kHz, with what the cloud needs to be made anew in between: edits a second, and the time of a
// tick with what it takes up. For docs/moving.md.
#include <sys/resource.h>
#include <time.h>

#include <algorithm>
#include <cstdio>
#include <cstring>

#include "vfplan/engine.hpp"

namespace {

double now() {  // of this thread [s]
    timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

/// n points of a sheet with a spacing of 0.5 mm, gently waved.
std::vector<double> sheet(std::size_t n) {
    const int side = int(std::sqrt(double(n)));
    std::vector<double> xyz;
    for (int i = 0; i < side; ++i)
        for (int j = 0; j < side; ++j) {
            const double x = 5e-4 * (i - side / 2), y = 5e-4 * (j - side / 2);
            xyz.insert(xyz.end(), {x, y, 1e-3 * std::sin(60 * x) * std::sin(50 * y)});
        }
    return xyz;
}

/// A cloud of which points go and come back a little lower, around a tool that wanders.
struct Burred {
    std::vector<double> xyz;
    std::vector<std::uint32_t> number;
    vfplan::Engine engine;
    std::uint32_t next;
    std::size_t at = 0, side;

    explicit Burred(std::size_t n)
        : xyz(sheet(n)),
          number(xyz.size() / 3),
          engine(xyz.data(), number.size(), parameters()),
          next(std::uint32_t(number.size())),
          side(std::size_t(std::sqrt(double(number.size())))) {
        for (std::uint32_t i = 0; i < next; ++i) number[i] = i;
    }
    static vfplan::Parameters parameters() {
        vfplan::Parameters p;
        p.band = 5e-5;
        p.search = vfplan::Search::editable;
        return p;
    }
    /// Along rows, each from edge to edge, in the middle tenth of the sheet.
    std::size_t place() {
        const std::size_t wide = std::min(side, std::max<std::size_t>(side / 10, 64)), k = at++;
        const std::size_t i = (k / wide) % wide, j = k % wide;
        return (side / 2 - wide / 2 + i) * side + side / 2 - wide / 2 + j;
    }
    bool edit(int pairs) {
        std::uint32_t gone[64];
        double come[192];
        for (int i = 0; i < pairs; ++i) {
            const std::size_t p = place();
            gone[i] = number[p];
            number[p] = next++;
            xyz[3 * p + 2] -= 1e-5;
            std::memcpy(come + 3 * i, &xyz[3 * p], 3 * sizeof(double));
        }
        return engine.edit(gone, std::size_t(pairs), come, std::size_t(pairs));
    }
    vfplan::Vec3 tool() const {
        const double phase = 1e-4 * double(at % 60000);
        return {{20e-3 * std::sin(phase), 20e-3 * std::cos(1.3 * phase), 3e-3}};
    }
};

double worth(std::size_t n) {
    Burred b(n);
    b.engine.reset({{0, 0, 8e-3}});
    for (int i = 0; i < 2; ++i) {  // what grows has grown
        b.edit(32);
        b.engine.step(b.tool());
    }
    const int rounds = n > 200'000 ? 8 : 20;
    double edit = 0, remake = 0, taken = 0;
    for (int i = 0; i < rounds; ++i) {
        double t = now();
        b.edit(32);
        edit += now() - t;
        t = now();
        b.engine.step(b.tool());
        taken += now() - t;
        t = now();
        b.engine.remake();
        remake += now() - t;
        b.engine.step(b.tool());
    }
    std::printf("| %zu | %.1f | %.1f | %.0f |\n", n, 1e6 * edit / rounds, 1e6 * taken / rounds,
                1e6 * remake / rounds);
    return remake / edit;
}

void sustained(std::size_t n, double seconds) {
    Burred b(n);
    b.engine.reset({{0, 0, 8e-3}});
    std::vector<double> ticks;
    double editing = 0, longest = 0;
    std::uint64_t most = 0;
    const long count = long(2000 * seconds);
    for (long k = 0; k < count; ++k) {
        const double began = now();
        const bool handed = b.edit(26);
        const double took = now() - began;
        editing += took;
        longest = std::max(longest, took);
        if (!handed) std::printf("not handed over at tick %ld\n", k);
        const std::uint64_t before = b.engine.changes_applied();
        const double t = now();
        b.engine.step(b.tool());
        ticks.push_back(now() - t);
        most = std::max(most, b.engine.changes_applied() - before);
    }
    std::sort(ticks.begin(), ticks.end());
    const auto part = [&](double p) { return 1e6 * ticks[std::size_t(p * double(count - 1))]; };
    std::printf(
        "%zu points: %.0f edits a second of the loop, at most %llu taken a tick; ticks p50 %.1f "
        "us, "
        "p99 %.1f us, p99.9 %.1f us, most %.1f us; the editor works %.0f %% of the time, "
        "at longest %.0f ms\n",
        n, double(b.engine.changes_applied()) / seconds, static_cast<unsigned long long>(most),
        part(0.5), part(0.99), part(0.999), part(1), 100 * editing / seconds, 1e3 * longest);
}

}  // namespace

int main(int argc, char**) {
    const bool brief = argc > 1;
    std::printf(
        "| points | edit of 64 [us] | its tick [us] | made anew [us] |\n|---|---|---|---|\n");
    for (const std::size_t n : {400, 625, 2'500, 10'000, 40'000, 160'000, 1'000'000})
        if (!brief || n < 50'000) worth(n);
    sustained(brief ? 40'000 : 1'000'000, brief ? 0.5 : 20);
    return 0;
}
