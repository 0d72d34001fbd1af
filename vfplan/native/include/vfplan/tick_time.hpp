// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// How long a tick may take, from a fixture and its rendering alone, before the first tick.
//
// Two figures are known. One follows from counts: iterations, and the points, features or triangles
// that lie together, each with the time that it costs. A tick among real shapes takes up to eighty
// times less, for it seldom uses its iterations. So the bound that an engine is held to comes from
// a search: HIPs are led about where the geometry is most laborious, the work of each tick is
// counted, and the bound is 3 us and 2.2 times the most that was found.
// tests/engine/test_worst_tick.py holds it against measured ticks of fixtures of every kind. All
// times are those of the machine of docs/engine.md.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "vfplan/curve/pieces.hpp"
#include "vfplan/engine.hpp"
#include "vfplan/mesh/triangles.hpp"
#include "vfplan/parameters.hpp"

namespace vfplan::inline v1 {

/// Time [s] that a tick takes by what it may have to look at: all its iterations, at the place
/// where most lies together. It follows from the counts, and is much too careful.
VFPLAN_COMPILED_ONCE double proven_tick_time(const double* xyz, std::size_t n, const Parameters& p);
VFPLAN_COMPILED_ONCE double proven_tick_time(const std::vector<Stroke>& strokes,
                                             const Parameters& p);
/// The inner steps that the rule grants, and the triangles that lie together, which a part of a
/// tick looks through to the end.
VFPLAN_COMPILED_ONCE double proven_tick_time(const mesh::Surface& surface, const Parameters& p);

namespace detail {

/// The work of the worst tick that a search finds [s]. It tries many places of the geometry for a
/// few ticks each, the more laborious half of them for twice as long, and so on, to one place in
/// the end. A HIP starts near a place or on it, perhaps inside, and is led at up to 3 m/s to random
/// goals: most of them close, some far behind, and one in four at another place of the geometry, so
/// that much may lie between the HIP and its proxy. The work is counted and not timed, so that the
/// search finds the same everywhere.
inline double most_work_found(EngineImpl& engine, const std::vector<Vec3>& geometry) {
    constexpr std::size_t places = 256;
    constexpr int first_ticks = 16;
    constexpr int ticks_a_goal = 30;
    constexpr double share_of_far_goals = 0.25;
    constexpr double share_of_starts_on_it = 0.125;  // where a sum of directions may cancel
    constexpr double furthest_goal = 8;              // [R]; proxies that turn round a ring need it
    constexpr double largest_step = 3e-3;            // of a HIP of 3 m/s in a tick [m]

    std::uint64_t state = 42;
    const auto random = [&state](double low, double high) {
        state = state * 6364136223846793005ull + 1442695040888963407ull;
        return low + (high - low) * static_cast<double>(state >> 11) * 0x1p-53;
    };
    const auto any_place = [&] {
        const double number = random(0, static_cast<double>(geometry.size()));
        return geometry[static_cast<std::size_t>(number)];
    };
    const auto around = [&](const Vec3& place, double reach) {
        Vec3 x;
        for (int k = 0; k < 3; ++k) x[k] = place[k] + random(-reach, reach);
        return x;
    };
    const auto most_work = [&](const Vec3& place, int ticks) {
        double start_reach = 0;
        if (random(0, 1) >= share_of_starts_on_it) start_reach = random(0, 3) * engine.radius;
        Vec3 hip = around(place, start_reach);
        Vec3 goal = place;
        double most = 0;
        engine.reset(hip);
        for (int t = 0; t < ticks; ++t) {
            if (t % ticks_a_goal == 0) {
                if (random(0, 1) < share_of_far_goals) {
                    goal = around(any_place(), engine.radius);
                } else {
                    const double share = random(0, 1);
                    goal = around(place, furthest_goal * share * share * share * engine.radius);
                }
            }
            const Vec3 way = goal - hip;
            hip = hip + along(way, std::min(norm(way), largest_step));
            const double before = engine.work_time();
            engine.step(hip);
            most = std::max(most, engine.work_time() - before);
        }
        return most;
    };

    struct TriedStart {
        double work;
        Vec3 at;
    };
    std::vector<TriedStart> tried;
    for (std::size_t i = 0; i < places; ++i) tried.push_back({0, any_place()});
    double most = 0;
    for (int ticks = first_ticks; !tried.empty(); ticks *= 2) {
        for (TriedStart& place : tried) {
            place.work = most_work(place.at, ticks);
            most = std::max(most, place.work);
        }
        std::stable_sort(tried.begin(), tried.end(),
                         [](const TriedStart& a, const TriedStart& b) { return a.work > b.work; });
        tried.resize(tried.size() / 2);
    }
    return most;
}

/// What a search misses of the worst tick, and what a count misses of its time. docs/engine.md has
/// the bound over the worst tick measured for it.
inline constexpr double search_margin = 2.2;

/// What a tick takes besides that no count tells [s]: the first one reads memory that no cache
/// holds yet.
inline constexpr double uncounted_time = 3e-6;

/// `search_margin` times what the search finds, and what is not counted, but no more than is
/// proven [s].
inline double bound_by_search(EngineImpl& engine, const std::vector<Vec3>& geometry,
                              double proven) {
    return std::min(proven, uncounted_time + search_margin * most_work_found(engine, geometry));
}

inline std::vector<Vec3> rows_of(const double* xyz, std::size_t n) {
    std::vector<Vec3> rows(n);
    for (std::size_t i = 0; i < n; ++i) rows[i] = {{xyz[3 * i], xyz[3 * i + 1], xyz[3 * i + 2]}};
    return rows;
}

}  // namespace detail

/// Time [s] that a tick among n points takes at most: 3 us and 2.2 times the most that a search
/// finds, or `proven_tick_time` where that is less or where a tick may use more than 32 iterations.
/// It is for HIPs of up to 3 m/s: one that jumps also costs what lies along its way. Throws
/// std::invalid_argument, as all these functions do.
inline double tick_time_bound(const double* xyz, std::size_t n, const Parameters& p) {
    // A search seldom meets the tick that uses hundreds of iterations.
    constexpr int max_searched_iterations = 32;
    if (p.rule == Rule::robust && p.max_iterations > max_searched_iterations)
        return proven_tick_time(xyz, n, p);
    const detail::SearchableEngine made = detail::make_searchable(xyz, n, p);
    return detail::bound_by_search(*made.engine, detail::rows_of(xyz, n), made.proven_time);
}
/// The same of rule exact among lines and arcs.
inline double tick_time_bound(const std::vector<Stroke>& strokes, const Parameters& p) {
    const double proven = proven_tick_time(strokes, p);
    std::vector<Vec3> corners;
    for (const Stroke& stroke : strokes) {
        const auto more = detail::rows_of(stroke.vertices.data(), stroke.vertices.size() / 3);
        corners.insert(corners.end(), more.begin(), more.end());
    }
    return detail::bound_by_search(*detail::make_impl(strokes, p), corners, proven);
}
/// The same of rule exact among triangles.
inline double tick_time_bound(const mesh::Surface& surface, const Parameters& p) {
    const double proven = proven_tick_time(surface, p);
    return detail::bound_by_search(*detail::make_impl(surface, p),
                                   detail::rows_of(surface.points, surface.n), proven);
}

/// Whether a mesh is rendered best by its triangles: nearer to the truth than by its points
/// (docs/make_mesh.py), if a tick is proven to be short enough.
inline bool by_triangles(const mesh::Surface& surface, const Parameters& p) {
    return proven_tick_time(surface, p) <= max_tick_time;
}

}  // namespace vfplan::inline v1
