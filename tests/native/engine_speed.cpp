// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// What a tick costs, against what one would write instead, in one run with the same flags, the same
// path and therefore the same share of contact:
//
//   g++ -std=c++20 -O3 -ffp-contract=off -Ivfplan/native/include tests/native/engine_speed.cpp
//   ./a.out [--brief]
//
// brute force: the paper's rule over every point. nanoflann: its radius search, then the same rule
// on what it found (apt package libnanoflann-dev; said when absent). Ours: the shipped engine. The
// proxies of all three are compared as they go. Times are the
// thread's processor time, medians over rounds taken in turns; the tail of a tick is wall time.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <ctime>

#include "scenes.hpp"
#include "vfplan/cloud/band.hpp"
#include "vfplan/engine.hpp"

#if __has_include(<nanoflann.hpp>)
#include <nanoflann.hpp>
#define HAVE_NANOFLANN 1
#else
#define HAVE_NANOFLANN 0
#endif

namespace {

using vfplan::Vec3;
using Clock = std::chrono::steady_clock;

/// The paper's rule over a list of neighbours, as one would write it.
class PlainRule {
  public:
    PlainRule(const scenes::Points& xyz, const vfplan::Parameters& p) : xyz_(xyz), p_(p) {}

    template <class Each>  // each(f): f(index) for every point that may be a neighbour
    void step(Vec3& x, const Vec3& hip, Each&& each) const {
        const double r1 = p_.r1(), r3 = p_.outer_radius, R = p_.R();
        near_.clear();
        double nearest = 1e300;
        Vec3 sum;
        each([&](std::size_t i) {
            const Vec3 w = x - at(i);
            const double r = norm(w);
            if (!(r < r3)) return;
            near_.push_back(i);
            nearest = std::min(nearest, r);
            const double t = std::clamp((r - r1) / (r3 - r1), 0.0, 1.0), q = (1 - t) * (1 - t);
            if (r > 0) sum = sum + ((1 + 4 * t) * q * q / r) * w;
        });
        if (near_.empty()) {
            x = hip;
            return;
        }
        const Vec3 n = vfplan::along(sum, 1), u = hip - x;
        if (nearest < r1) {
            double d = 0;
            for (std::size_t i : near_) {
                const Vec3 w = at(i) - x;
                const double a = dot(w, n), inside = R * R - dot(w, w);
                if (dot(w, w) < r1 * r1) d = std::max(d, a + std::sqrt(a * a + inside));
            }
            x = x + d * n;
        } else if (nearest <= p_.r2()) {
            const Vec3 up = u - dot(n, u) * n;
            x = x + vfplan::along(dot(n, u) < 0 ? up : u, std::min(norm(up), r1));
        } else {
            const double length = norm(u);
            if (length == 0) return;
            const Vec3 way = (1 / length) * u;
            double d = length, to_hip = 0, to_proxy = 0;
            for (std::size_t i : near_) {
                const Vec3 w = at(i) - x;
                const double a = dot(w, way), under = a * a - dot(w, w) + R * R;
                to_hip += norm(at(i) - hip);
                to_proxy += norm(w);
                if (under >= 0 && a - std::sqrt(under) >= 0) d = std::min(d, a - std::sqrt(under));
            }
            x = dot(n, u) >= 0 && to_hip > to_proxy ? hip : x + d * way;
        }
    }

  private:
    Vec3 at(std::size_t i) const { return {{xyz_[3 * i], xyz_[3 * i + 1], xyz_[3 * i + 2]}}; }

    const scenes::Points& xyz_;
    const vfplan::Parameters& p_;
    mutable std::vector<std::size_t> near_;
};

/// Presses 3 mm deep and slides about over 40 mm at up to 0.2 m/s, lifting off now and then.
std::vector<Vec3> pressing(long ticks) {
    std::vector<Vec3> path;
    for (long i = 0; i < ticks; ++i) {
        const double t = 1e-3 * static_cast<double>(i);
        path.push_back({{0.02 * std::sin(7.1 * t), 0.02 * std::cos(5.3 * t),
                         0.0045 + 0.0025 * std::sin(3.3 * t)}});
    }
    return path;
}

/// Processor time of this thread: what other programs take meanwhile does not count.
double cpu_seconds() {
    timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

template <class Tick>
double microseconds(const std::vector<Vec3>& path, Tick&& tick) {
    const double before = cpu_seconds();
    for (const Vec3& hip : path) tick(hip);
    return 1e6 * (cpu_seconds() - before) / static_cast<double>(path.size());
}

double median(std::vector<double> v) {
    std::nth_element(v.begin(), v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2), v.end());
    return v[v.size() / 2];
}

vfplan::Engine engine(const scenes::Points& xyz, vfplan::Parameters p, vfplan::Rule rule) {
    p.rule = rule;
    if (rule == vfplan::Rule::robust) p.band = 1.2516e-5;  // dimple depth of the sheet
    return vfplan::Engine(xyz.data(), xyz.size() / 3, p);
}

#if HAVE_NANOFLANN
struct Adaptor {
    const scenes::Points& xyz;
    std::size_t kdtree_get_point_count() const { return xyz.size() / 3; }
    double kdtree_get_pt(std::size_t i, std::size_t k) const { return xyz[3 * i + k]; }
    template <class B>
    bool kdtree_get_bbox(B&) const {
        return false;
    }
};
using Tree =
    nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, Adaptor>, Adaptor, 3>;
#endif

void against_others(int rounds, long ticks) {
    const auto xyz = scenes::sheet(201, 5e-4);
    const auto path = pressing(ticks);
    const std::vector<Vec3> few(path.begin(), path.begin() + ticks / 4);
    vfplan::Parameters p;
    const PlainRule rule(xyz, p);
    const Vec3 start{{0, 0.02, 0.02}};
    std::vector<double> brute, flann, paper, robust;
    Vec3 a, b;
#if HAVE_NANOFLANN
    const Adaptor adaptor{xyz};
    Tree tree(3, adaptor, nanoflann::KDTreeSingleIndexAdaptorParams(10));
    tree.buildIndex();
#endif
    auto ours = engine(xyz, p, vfplan::Rule::paper), best = engine(xyz, p, vfplan::Rule::robust);
    long contact = 0;
    double apart = 0;
    for (int round = 0; round < rounds; ++round) {
        a = b = start;
        brute.push_back(microseconds(few, [&](const Vec3& hip) {
            rule.step(a, hip, [&](auto&& f) {
                for (std::size_t i = 0; i < xyz.size() / 3; ++i) f(i);
            });
        }));
#if HAVE_NANOFLANN
#if NANOFLANN_VERSION >= 0x150
        std::vector<nanoflann::ResultItem<std::uint32_t, double>> found;
        const nanoflann::SearchParameters search(0, false);
#else
        std::vector<std::pair<std::uint32_t, double>> found;
        const nanoflann::SearchParams search(32, 0, false);
#endif
        const double r2 = p.outer_radius * p.outer_radius;  // nanoflann's radii are squared
        flann.push_back(microseconds(path, [&](const Vec3& hip) {
            tree.radiusSearch(b.c, r2, found, search);
            rule.step(b, hip, [&](auto&& f) {
                for (const auto& item : found) f(item.first);
            });
        }));
#endif
        ours.reset(start);
        best.reset(start);
        Vec3 last;
        paper.push_back(microseconds(path, [&](const Vec3& hip) {
            const auto s = ours.step(hip);
            contact += round == 0 && s.state >= vfplan::State::in_contact;
            last = s.proxy;
        }));
        robust.push_back(microseconds(path, [&](const Vec3& hip) { best.step(hip); }));
        if (HAVE_NANOFLANN) apart = std::max(apart, norm(last - b));
    }
    std::printf(
        "sheet of 40401 points, %.0f %% of the ticks in contact: time of a tick [us], median of %d "
        "rounds\n",
        100.0 * static_cast<double>(contact) / static_cast<double>(ticks), rounds);
    const double p_us = median(paper), r_us = median(robust);
    std::printf("  brute force, paper's rule    %8.2f   ours is %5.1f x faster\n", median(brute),
                median(brute) / p_us);
    if (flann.empty()) {
        std::printf("  nanoflann: absent (apt package libnanoflann-dev), not compared\n");
    } else {
        std::printf("  nanoflann, paper's rule      %8.2f   ours is %5.1f x faster\n",
                    median(flann), median(flann) / p_us);
        std::printf("  nanoflann, paper's rule      %8.2f   our robust is %5.1f x faster\n",
                    median(flann), median(flann) / r_us);
        std::printf("  after the whole path our proxy is %.1e m from nanoflann's%s\n", apart,
                    apart < 1e-6 ? "" : " DISAGREE");
    }
    std::printf("  ours, paper                  %8.2f\n  ours, robust                 %8.2f\n",
                p_us, r_us);
}

/// What is left of a tick at rest, and what eq. (1) takes of one in contact, over points in a list.
void parts(int rounds, long ticks) {
    const auto xyz = scenes::sheet(201, 5e-4);
    const std::vector<Vec3> still(static_cast<std::size_t>(ticks), Vec3{{1.3e-4, 2.1e-4, 3e-3}});
    for (auto rule : {vfplan::Rule::paper, vfplan::Rule::robust}) {
        auto e = engine(xyz, {}, rule);
        e.reset({{0, 0, 0.02}});
        std::vector<double> us;
        for (int r = 0; r < rounds + 1; ++r)  // comes to rest in the first
            us.push_back(microseconds(still, [&](const Vec3& h) { e.step(h); }));
        us.erase(us.begin());
        std::printf("  HIP held still, %-6s       %8.2f\n",
                    rule == vfplan::Rule::paper ? "paper" : "robust", median(us));
    }
    const vfplan::Parameters p;
    const Vec3 x{{1.3e-4, 2.1e-4, 5e-3}};
    scenes::Points near;
    for (std::size_t i = 0; i < xyz.size(); i += 3)
        if (norm(Vec3{{xyz[i], xyz[i + 1], xyz[i + 2]}} - x) <= 1.05 * p.outer_radius)
            scenes::add(near, xyz[i], xyz[i + 1], xyz[i + 2]);
    const auto list = vfplan::make_cloud(vfplan::Space{}, near.data(), near.size() / 3);
    const auto& loops = vfplan::kernels<3>;
    std::vector<double> us;
    for (int r = 0; r < rounds; ++r)
        us.push_back(microseconds(still, [&](const Vec3&) {
            vfplan::NormalSum<3> sum;
            loops.normal(list.span(0, list.size()), x, p.r1(), p.outer_radius, sum);
        }));
    std::printf("  eq. (1) alone, %4zu points   %8.2f\n", list.size(), median(us));
}

void tail(long ticks) {
    const auto xyz = scenes::sheet(201, 5e-4);
    const auto path = pressing(ticks);
    for (auto rule : {vfplan::Rule::paper, vfplan::Rule::robust}) {
        auto e = engine(xyz, {}, rule);
        std::vector<double> us;
        for (const Vec3& hip : path) {
            const auto before = Clock::now();
            e.step(hip);
            us.push_back(std::chrono::duration<double, std::micro>(Clock::now() - before).count());
        }
        std::sort(us.begin(), us.end());
        const auto q = [&](double f) {
            return us[static_cast<std::size_t>(f * (us.size() - 1.0))];
        };
        std::printf("  %-6s p50 %.2f  p99 %.2f  p99.9 %.2f  max %.2f us\n",
                    rule == vfplan::Rule::paper ? "paper" : "robust", q(0.5), q(0.99), q(0.999),
                    us.back());
    }
}

void growth(bool brief, int rounds, long ticks) {
    std::printf(
        "more points at the same spacing: time of a tick, and its ratio to that of the first "
        "cloud\n");
    const auto path = pressing(ticks);
    double first[2] = {};
    for (int n : brief ? std::vector{101, 201} : std::vector{201, 1001, 2001}) {
        const auto xyz = scenes::sheet(n, 5e-4);
        std::printf("  %8d points:", n * n);
        for (auto rule : {vfplan::Rule::paper, vfplan::Rule::robust}) {
            const auto before = Clock::now();
            auto e = engine(xyz, {}, rule);
            const double built = std::chrono::duration<double>(Clock::now() - before).count();
            std::vector<double> us;
            for (int r = 0; r < rounds; ++r) {
                e.reset({{0, 0.02, 0.02}});
                us.push_back(microseconds(path, [&](const Vec3& h) { e.step(h); }));
            }
            double& base = first[rule == vfplan::Rule::paper];
            if (base == 0) base = median(us);
            std::printf("  %s %.2f us (x %.2f), built in %.3f s, %.1f bytes a point;",
                        rule == vfplan::Rule::paper ? "paper" : "robust", median(us),
                        median(us) / base, built, static_cast<double>(e.bytes()) / n / n);
        }
        std::printf("\n");
    }
}

/// Points of a grid within half a spacing of the top of a ball.
scenes::Points shell(double h) {
    constexpr double radius = 0.02;
    scenes::Points p;
    const int n = static_cast<int>(radius / h) + 2;
    for (int i = -n; i <= n; ++i)
        for (int j = -n; j <= n; ++j)
            for (int k = n / 2; k <= n; ++k)
                if (std::abs(h * std::sqrt(double(i * i + j * j + k * k)) - radius) < h / 2)
                    scenes::add(p, i * h, j * h, k * h - radius);
    return p;
}

/// Median and worst tick, of each tick the least of `rounds`: over all points, and thinned.
void dense(const char* name, const scenes::Points& xyz, double middle, int rounds, int ticks) {
    std::printf("    %-12s %7zu points:", name, xyz.size() / 3);
    vfplan::Parameters p;
    p.band = vfplan::band_for(xyz.data(), xyz.size() / 3, p);
    for (const auto search : {vfplan::Search::editable, vfplan::Search::automatic}) {
        p.search = search;
        const double began = cpu_seconds();
        vfplan::Engine e(xyz.data(), xyz.size() / 3, p);
        const double built = cpu_seconds() - began;
        std::vector<double> us(static_cast<std::size_t>(ticks), 1e300);
        for (int r = 0; r < rounds; ++r) {
            e.reset({{0.01, 0.01, 0.012}});
            for (int i = 0; i < ticks; ++i) {
                const double t = 8.0 * i / ticks;
                const Vec3 hip{{middle + 0.006 * std::sin(2.1 * t),
                                middle + 0.006 * std::cos(1.7 * t),
                                0.003 + 0.004 * std::sin(1.3 * t)}};
                const double before = cpu_seconds();
                e.step(hip);
                double& least = us[static_cast<std::size_t>(i)];
                least = std::min(least, 1e6 * (cpu_seconds() - before));
            }
        }
        std::printf("  %s %.1f / %.0f us, made in %.2f s;",
                    search == vfplan::Search::editable ? "all" : "thinned", median(us),
                    *std::max_element(us.begin(), us.end()), built);
    }
    std::printf("\n");
}

void density(bool brief) {
    std::printf("more points on the same surface: median / worst tick of rule robust\n");
    const int rounds = brief ? 1 : 3, ticks = brief ? 200 : 2000;
    for (const double fine : brief ? std::vector{10.0} : std::vector{10.0, 40.0, 140.0}) {
        const double h = vfplan::Parameters{}.R() / fine;
        const auto side = [&](double length) { return static_cast<int>(length / h) + 1; };
        std::printf("  R/h %.0f\n", fine);
        dense("sheet", scenes::sheet(side(0.03), h), 0, rounds, ticks);
        dense("voxel shell", shell(h), 0, rounds, ticks);
        dense("three walls", scenes::corner(side(0.02), h), 0.005, rounds, ticks);
    }
}

void left_out(int rounds, long ticks) {
    std::printf("time of a tick [us] with / without a part of the engine\n");
    const auto time = [&](const scenes::Points& xyz, const vfplan::Parameters& p) {
        vfplan::Engine e(xyz.data(), xyz.size() / 3, p);
        std::vector<double> us;
        const auto path = pressing(ticks);
        for (int r = 0; r < rounds; ++r) {
            e.reset({{0.1, 0.02, 0.02}});
            us.push_back(microseconds(
                path, [&](const Vec3& h) { e.step({{0.03 + h[2] - 0.002, h[0], 0}}); }));
        }
        return median(us);
    };
    const auto circle = scenes::circle(377, 0.03);
    for (auto rule : {vfplan::Rule::paper, vfplan::Rule::robust}) {
        const char* name = rule == vfplan::Rule::paper ? "paper" : "robust";
        vfplan::Parameters p, planar, diagonal, thick;
        p.rule = rule;
        planar = p;
        planar.ignore_axis = Vec3{{0, 0, 1}};
        diagonal = planar;
        diagonal.stiffness = {{1000, 1000, 1001}};
        thick = planar;
        thick.contact_radius = 4e-3;
        thick.point_radius = 1e-3;
        std::printf("  %-6s third coordinate %.3f / %.3f", name, time(circle, p),
                    time(circle, planar));
        std::printf(", diagonal stiffness %.3f / %.3f", time(circle, diagonal),
                    time(circle, planar));
        std::printf(", point radius %.3f / %.3f\n", time(circle, thick), time(circle, planar));
        for (int n : {24, 48, 96, 192, 384, 768, 1536}) {
            const auto ring = scenes::circle(n, 0.03);
            vfplan::Parameters grid = planar, brute = planar;
            grid.search = vfplan::Search::grid;
            brute.search = vfplan::Search::brute;
            std::printf("  %-6s %5d points: grid %.3f / %.3f\n", name, n, time(ring, grid),
                        time(ring, brute));
        }
    }
    std::printf("time of a tick [us] on the sheet, by the width of the registers\n");
    const auto xyz = scenes::sheet(201, 5e-4);
    const auto path = pressing(ticks);
    for (auto rule : {vfplan::Rule::paper, vfplan::Rule::robust})
        for (int width : {2, 4, 8}) {
            if (width > static_cast<int>(vfplan::widest())) continue;
            vfplan::use_width(static_cast<vfplan::Width>(width));
            auto e = engine(xyz, {}, rule);
            std::vector<double> us;
            for (int r = 0; r < rounds; ++r)
                us.push_back(microseconds(path, [&](const Vec3& h) { e.step(h); }));
            std::printf("  %-6s %d float64: %.2f\n",
                        rule == vfplan::Rule::paper ? "paper" : "robust", width, median(us));
        }
}

}  // namespace

int main(int argc, char** argv) {
    const bool brief = argc > 1 && std::strcmp(argv[1], "--brief") == 0;
    const int rounds = brief ? 1 : 7;
    const long ticks = brief ? 200 : 4000;
    against_others(rounds, ticks);
    parts(rounds, ticks);
    tail(brief ? 500 : 100000);
    growth(brief, rounds, ticks);
    density(brief);
    left_out(rounds, ticks);
}
