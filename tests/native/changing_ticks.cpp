// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
//   changing_ticks move IN OUT      rows t, hip from IN, poses among them; proxy, force, status out
//   changing_ticks exchange N       N engines put under a loop that runs
//   changing_ticks edit N           N points taken away from a cloud under a loop, and put back
//   changing_ticks make N           two threads make the first engines and step them N times
//
// Meanwhile the loop may not allocate, the force may not change by more than it may, and nothing
// may be read while it is written (built with ThreadSanitizer). Exit status 1 names the first
// failure.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <thread>

#include "allocations.hpp"
#include "vfplan/engine.hpp"
#include "vfplan/moving.hpp"

namespace {

using vfplan::Vec3;

[[noreturn]] void fail(const char* what, long tick, double value) {
    std::printf("%s at tick %ld: %.17g\n", what, tick, value);
    std::exit(1);
}

std::vector<double> sheet(int n, double spacing, double z) {
    std::vector<double> xyz;
    for (int i = -n; i <= n; ++i)
        for (int j = -n; j <= n; ++j) xyz.insert(xyz.end(), {i * spacing, j * spacing, z});
    return xyz;
}

vfplan::Engine sheet_engine(int n, double z, const vfplan::Parameters& p) {
    const auto xyz = sheet(n, 1e-3, z);
    return {xyz.data(), xyz.size() / 3, p};
}

/// Rule, plane, stiffness, radius and place of the k-th are others than those of the one before.
vfplan::Engine another(int k) {
    vfplan::Parameters p;
    p.contact_radius = 4e-3 + 1e-3 * (k % 3);
    p.band = 5e-5;
    for (double& c : p.stiffness.c) c = 500.0 * (1 + k % 4);
    if (k % 5 == 0) p.stiffness[2] = 750;
    const double z = 1e-3 * ((k * 37) % 11 - 5) / 5;
    if (k % 2) p.ignore_axis = Vec3{{0, 1, 0}};
    if (k % 4 == 3) return {std::vector<vfplan::Stroke>{{{-1, 0, z, 1, 0, z}, {0, 0}, false}}, p};
    return sheet_engine(20, z, p);
}

/// Of a look: its budget, and what it looks at last.
constexpr std::int64_t look_steps_and_a_leaf = vfplan::detail::EngineImpl::look_steps + 14;

struct Loop {
    vfplan::Engine& engine;
    double stiffness, radius;
    long tick = 0, inside = 0, changing = 0;
    vfplan::Step last;
    Vec3 hip_before;

    /// Pressed into the sheet from above, and moved along it.
    void step(double depth) {
        const double phase = 1e-4 * double(tick % 40000);
        const Vec3 hip{{5e-3 * std::abs(phase - 2) - 5e-3, 1e-4, -depth}};
        const auto taken = engine.changes_applied();
        const bool was = last.status & vfplan::Status::changing;
        const long had = allocations;
        const vfplan::Step s = engine.step(hip);
        if (allocations != had) fail("allocation", tick, double(allocations - had));
        const double most = stiffness * (radius / 256 + norm(hip - hip_before));
        const double change = norm(s.force - last.force);
        if (tick > 0 && (was || taken != engine.changes_applied()) &&
            !(change <= most * (1 + 1e-9)))
            fail("force step", tick, change / most);
        inside += (s.status & vfplan::Status::inside) != 0;
        changing += (s.status & vfplan::Status::changing) != 0;
        last = s;
        hip_before = hip;
        ++tick;
    }
};

/// One triangle at the height z, n times: a look that comes within R has to look at each.
vfplan::Engine many_times(int n, double z) {
    const std::vector<double> corners{-1, -1, z, 1, -1, z, 0, 1, z};
    std::vector<std::int32_t> rows;
    for (int i = 0; i < n; ++i) rows.insert(rows.end(), {0, 1, 2});
    vfplan::Parameters p;
    const vfplan::mesh::Surface s{corners.data(), corners.size() / 3, rows.data(), rows.size() / 3};
    vfplan::WorkBudget look(vfplan::detail::EngineImpl::look_steps);
    const double found = vfplan::mesh::Mesh(s).distance({0, 0, z + 4e-3}, p.R(), &look);
    if (!look.is_spent() || found > 0) fail("a look that ends in time", n, found);
    if (look.total() > look_steps_and_a_leaf) fail("steps of a look", n, double(look.total()));
    return {s, p};
}

/// Of what waits a tick takes up one exchange; and none that it cannot look at in time, while the
/// proxy is on its way out, after a tick with bounded steps.
void wait() {
    vfplan::Engine engine = another(1);
    Loop loop{engine, 2000, 6e-3, 0, 0, 0, {}, {}};
    loop.step(-6e-3);
    for (int k = 2; k < 12; ++k) engine.exchange(another(k));
    for (std::uint64_t k = 1, ticks = 0; k <= 10; k = engine.changes_applied() + 1) {
        loop.step(-6e-3);
        if (engine.changes_applied() > k) fail("exchanges in a tick", loop.tick, double(k));
        if (++ticks > 10000) fail("not taken up", loop.tick, double(k));
    }
    vfplan::Parameters p;
    p.band = 5e-5;
    vfplan::Engine led = sheet_engine(20, 0, p);
    led.reset({0, 0, 6e-3});
    led.step({0, 0, 6e-3});
    led.exchange(sheet_engine(20, 2e-3, p));
    led.step({0, 0, 6e-3});
    led.exchange(many_times(20000, 2e-3));
    long ticks = 0;
    for (; led.changes_applied() == 1; ++ticks)
        if (led.step({0, 0, 6e-3}).status == vfplan::Status::ok && ticks > 1000)
            fail("never taken up", ticks, 0);
    if (ticks < 50) fail("taken up on the way out", ticks, 0);
}

/// Around a crowded fixture a tick looks by so many steps, and at a place more. It goes on in the
/// next, and the proxy keeps its side.
void look_back() {
    using vfplan::detail::make_impl;
    const auto crowd = sheet(150, 1e-4, 0), other = sheet(20, 1e-3, 4e-3);
    vfplan::Parameters p;
    p.band = 5e-5;
    const auto next = make_impl(other.data(), other.size() / 3, p);
    p.rule = vfplan::Rule::paper;  // thins nothing
    const auto before = make_impl(crowd.data(), crowd.size() / 3, p);
    const Vec3 hip{0, 0, 6e-3};
    next->continue_from(hip, before.get());
    before->distance({}, 2 * p.R(), &next->look);
    const auto most = next->look.total() + vfplan::detail::EngineImpl::look_steps;
    for (long tick = 0, looked = 0; tick < 2000; ++tick) {
        const auto had = next->look.total();
        const vfplan::Step s = next->step(hip);
        const auto steps = next->look.total() - had;
        looked += steps > 0;
        if (steps > most) fail("steps of looks", tick, double(steps));
        if (s.status & vfplan::Status::other_side) fail("led to the other side", tick, 0);
        if (s.status == vfplan::Status::ok && s.proxy[2] > 8.9e-3 && looked > 2) return;
    }
    fail("not led out, or in too few ticks", 2000, 0);
}

/// In the middle of a circle of 19,000 lines all are as near, and a tick looks at none of them.
void look_from_the_middle() {
    vfplan::Stroke circle{{}, std::vector<double>(19000), true};
    for (int i = 0; i < 19000; ++i) {
        const double turn = 2 * std::acos(-1.0) * i / 19000;
        for (const double c : {0.05 * std::cos(turn), 0.05 * std::sin(turn), 0.0})
            circle.vertices.push_back(c);
    }
    const vfplan::Parameters p;
    const vfplan::Slice plane(Vec3{0, 0, 1});
    vfplan::curve::CurveMotion motion({{circle}, plane, p.R()}, p);
    motion.begin_tick();
    if (!motion.is_outside({0, 0}) || motion.is_spent()) fail("a look at a whole circle", 0, 0);
}

void exchange(long n) {
    wait();
    look_from_the_middle();
    look_back();
    vfplan::Engine engine = another(0);
    engine.reset({{5e-3, 1e-4, 10e-3}});
    std::atomic<bool> done{false};
    std::thread editor([&] {
        for (long k = 1; k <= n; ++k) {
            vfplan::Engine other = another(int(k));
            while (!engine.exchange(std::move(other))) std::this_thread::yield();
            if (k % 3) std::this_thread::sleep_for(std::chrono::microseconds(300));
        }
        done = true;
    });
    Loop loop{engine, 2000, 6e-3, 0, 0, 0, {}, {}};
    double depth = -6e-3;
    for (bool last = false; !last || (loop.last.status & vfplan::Status::changing);) {
        last = done;
        depth = std::min(depth + 1e-5, 2e-3);
        loop.step(depth);
        if (!(loop.last.proxy[2] > 1e-3)) fail("the other side", loop.tick, loop.last.proxy[2]);
        const double clear = engine.distance(loop.last.proxy);
        if (!(loop.last.status & vfplan::Status::inside) && !(clear >= 4e-3 - 6e-5))
            fail("clearance", loop.tick, clear);
        if (loop.tick % 8 == 0) std::this_thread::yield();
    }
    editor.join();
    if (engine.changes_applied() != std::uint64_t(n))
        fail("not taken up", loop.tick, double(engine.changes_applied()));
    std::printf("exchanged %ld ticks %ld inside %ld changing %ld\n", n, loop.tick, loop.inside,
                loop.changing);
}

void edit(long n) {
    vfplan::Parameters p;
    p.band = 5e-5;
    p.search = vfplan::Search::editable;
    const auto xyz = sheet(75, 1e-3, 0);
    const auto size = std::uint32_t(xyz.size() / 3);
    vfplan::Engine engine(xyz.data(), size, p);
    std::vector<std::uint32_t> number(size);  // of the point now at each place
    for (std::uint32_t i = 0; i < size; ++i) number[i] = i;
    std::atomic<bool> done{false};
    std::thread editor([&] {
        std::uint32_t next = size, place = 0;
        for (long k = 0; k < n; k += 8) {
            std::uint32_t gone[8];
            double back[24];
            for (int i = 0; i < 8; ++i, place = (place + 7919) % size) {
                gone[i] = number[place];
                number[place] = next++;
                std::memcpy(back + 3 * i, &xyz[3 * place], sizeof(double[3]));
            }
            while (!engine.edit(gone, 8, back, 8)) {
                std::this_thread::yield();
                if (engine.remake()) break;
            }
            if (k % 64 == 0) std::this_thread::sleep_for(std::chrono::microseconds(200));
        }
        while (!engine.remake()) std::this_thread::yield();
        done = true;
    });
    Loop loop{engine, 1000, 5e-3, 0, 0, 0, {}, {}};
    double depth = -6e-3;
    for (bool last = false; !last || (loop.last.status & vfplan::Status::changing);) {
        last = done;
        depth = std::min(depth + 1e-5, 2e-3);
        loop.step(depth);
        if (!(loop.last.proxy[2] > 4e-3)) fail("fell through", loop.tick, loop.last.proxy[2]);
        if (loop.tick % 8 == 0) std::this_thread::yield();
    }
    editor.join();
    std::printf("edited %ld ticks %ld changing %ld\n", n, loop.tick, loop.changing);
}

/// Nothing has chosen the loops over points before.
void make(long n) {
    const auto work = [n] {
        vfplan::Parameters p;
        p.band = 5e-5;
        vfplan::Engine engine = sheet_engine(20, 0, p);
        Loop loop{engine, 1000, 5e-3, 0, 0, 0, {}, {}};
        while (loop.tick < n) loop.step(std::min(1e-5 * double(loop.tick) - 6e-3, 2e-3));
        if (!(loop.last.force[2] > 0)) fail("no force", loop.tick, loop.last.force[2]);
    };
    std::thread other(work);
    work();
    other.join();
    std::printf("made by two threads: %ld ticks each\n", n);
}

/// A row: kind 0: stamp, x y z, w x y z; kind 1: t, hip.
void move(const char* in, const char* out) {
    vfplan::Parameters p;
    p.max_hip_step = 0;
    vfplan::Engine engine = sheet_engine(20, 0, p);
    vfplan::MovingFrame frame({0.1, 0.25, 1, {{0, 0, 1e-3}}});
    std::FILE* from = std::fopen(in, "rb");
    std::FILE* to = std::fopen(out, "wb");
    if (!from || !to) fail("no file", 0, 0);
    double r[9];
    for (long tick = 0; std::fread(r, sizeof r, 1, from) == 1; ++tick) {
        const long had = allocations;
        if (r[0] == 0) {
            frame.pose(r[1], {{{r[2], r[3], r[4]}}, r[5], {{r[6], r[7], r[8]}}});
            continue;
        }
        const vfplan::Step s = frame.step(engine, r[1], {{r[2], r[3], r[4]}});
        if (allocations != had) fail("allocation", tick, double(allocations - had));
        const double row[7] = {s.proxy[0], s.proxy[1], s.proxy[2],      s.force[0],
                               s.force[1], s.force[2], double(s.status)};
        std::fwrite(row, sizeof row, 1, to);
    }
    std::fclose(from);
    std::fclose(to);
}

}  // namespace

int main(int argc, char** argv) {
    if (argc == 4 && !std::strcmp(argv[1], "move")) return move(argv[2], argv[3]), 0;
    if (argc == 3 && !std::strcmp(argv[1], "exchange")) return exchange(std::atol(argv[2])), 0;
    if (argc == 3 && !std::strcmp(argv[1], "edit")) return edit(std::atol(argv[2])), 0;
    if (argc == 3 && !std::strcmp(argv[1], "make")) return make(std::atol(argv[2])), 0;
    return 2;
}
