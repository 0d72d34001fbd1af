// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// A mesh as it is given, and samples of it.
#pragma once

#include "vfplan/cloud/points.hpp"
#if !defined(VFPLAN_COMPILED) || defined(VFPLAN_COMPILING)
#include <span>
#include <unordered_map>
#endif

namespace vfplan::inline v1::mesh {

/// A mesh as it is handed to the engine: three rows of points a triangle.
struct Surface {
    const double* points = nullptr;  ///< x y z of each in turn [m]
    std::size_t n = 0;
    const std::int32_t* triangles = nullptr;
    std::size_t k = 0;
};

/// A mesh that holds its own arrays, laid out as in Surface.
struct OwnedSurface {
    std::vector<double> points;
    std::vector<std::int32_t> triangles;
};

/// Most samples, and triangles between them, that are taken of a mesh: as many as a bundle may
/// hold.
inline constexpr std::size_t max_samples = 4'000'000;

/// Throws std::invalid_argument on a surface that no engine takes.
VFPLAN_ONCE void check(const Surface& s);

/// Samples of a mesh and the triangles between them: no place of it is farther than `cover` [m]
/// from the nearest sample. Sides that no triangle needs halved stay, so that a mesh that is fine
/// enough comes back as it is. Throws std::invalid_argument if that takes more than `max_samples`.
/// `longest_side` [m]: of a triangle that is to be cut; without one, what the cover allows.
VFPLAN_ONCE OwnedSurface sampled(const Surface& s, double cover,
                                 std::optional<double> longest_side = {});

/// Largest distance [m] of a place in a triangle of these sides from its nearest corner.
inline double covering_radius(std::array<double, 3> sides) noexcept {
    std::sort(sides.begin(), sides.end());
    const auto [a, b, c] = sides;
    if (c == 0) return 0;
    // In an obtuse triangle the farthest place lies on the longest side, else it is the
    // circumcentre.
    if (a * a + b * b <= c * c) return b * b * c / (b * b + c * c - a * a);
    const double product = (a + (b + c)) * (c - (a - b)) * (c + (a - b)) * (a + (b - c));
    return a * b * c / std::sqrt(std::max(product, 0.0));
}

#if !defined(VFPLAN_COMPILED) || defined(VFPLAN_COMPILING)
VFPLAN_ONCE void check(const Surface& s) {
    if (s.k == 0) reject("the mesh has no triangle. Give at least one.");
    check_coordinates(s.points, s.n);
    for (std::size_t i = 0; i < 3 * s.k; ++i)
        if (s.triangles[i] < 0 || static_cast<std::size_t>(s.triangles[i]) >= s.n)
            reject("triangle " + std::to_string(i / 3) + " names point " +
                   std::to_string(s.triangles[i]) + " of " + std::to_string(s.n) +
                   ", which are numbered from 0. Name points that are there.");
}

/// Cuts triangles until their corners sample the surface.
///
/// A triangle is cut where a place of it is farther than `cover` [m] from its corners: its sides
/// longer than `longest_side` [m] are halved, in both triangles that share them, as often as it
/// takes. The corners that were given keep their numbers, and the surface stays as it is.
class Refinement {
  public:
    Refinement(const Surface& s, double longest_side, double cover)
        : longest_side_(longest_side), cover_(cover) {
        check(s);
        made_.points.assign(s.points, s.points + 3 * s.n);
        made_.triangles.assign(s.triangles, s.triangles + 3 * s.k);
        while (mark_long_sides()) cut_marked_sides();
    }

    OwnedSurface take() { return std::move(made_); }

  private:
    Vec3 at(std::int32_t row) const noexcept {
        return point_at(made_.points.data(), static_cast<std::size_t>(row));
    }
    double length(std::int32_t a, std::int32_t b) const noexcept { return norm(at(b) - at(a)); }

    static std::uint64_t side(std::int32_t a, std::int32_t b) noexcept {
        const auto low = static_cast<std::uint64_t>(std::min(a, b));
        return low << 32 | static_cast<std::uint64_t>(std::max(a, b));
    }

    /// Gives each side that is to be halved its middle. False if there is none.
    bool mark_long_sides() {
        middles_.clear();
        for (std::size_t i = 0; i < made_.triangles.size(); i += 3) {
            const std::int32_t* t = made_.triangles.data() + i;
            const std::array<double, 3> sides{length(t[0], t[1]), length(t[1], t[2]),
                                              length(t[2], t[0])};
            constexpr double roundings = 1 + 1e-9;
            if (covering_radius(sides) <= cover_ * roundings) continue;
            for (std::size_t k = 0; k < 3; ++k)
                if (sides[k] > longest_side_) mark(t[k], t[(k + 1) % 3]);
        }
        return !middles_.empty();
    }

    void mark(std::int32_t a, std::int32_t b) {
        const std::size_t row = made_.points.size() / 3;
        if (!middles_.try_emplace(side(a, b), static_cast<std::int32_t>(row)).second) return;
        if (row >= max_samples) reject_as_too_many();
        const Vec3 middle = 0.5 * (at(a) + at(b));
        for (const double c : middle.c) made_.points.push_back(c);
    }

    /// Cuts each triangle between the middles of its marked sides.
    void cut_marked_sides() {
        std::vector<std::int32_t> cut;
        cut.reserve(made_.triangles.size());
        for (std::size_t i = 0; i < made_.triangles.size(); i += 3) {
            std::array<std::int32_t, 3> t{made_.triangles[i], made_.triangles[i + 1],
                                          made_.triangles[i + 2]};
            std::array<std::int32_t, 3> m{middle(t[0], t[1]), middle(t[1], t[2]),
                                          middle(t[2], t[0])};
            const auto marked =
                std::count_if(m.begin(), m.end(), [](auto row) { return row >= 0; });
            // Turned so that one marked side is the first, and of two the other is the second.
            while ((marked == 1 && m[0] < 0) || (marked == 2 && m[2] >= 0)) {
                std::rotate(t.begin(), t.begin() + 1, t.end());
                std::rotate(m.begin(), m.begin() + 1, m.end());
            }
            // Corners 0 to 2, and 3 to 5 the middles of the sides behind them. What is left of a
            // triangle with two marked sides has four; its shorter diagonal parts it.
            static constexpr std::array<int, 3> none[] = {{0, 1, 2}},
                                                one[] = {{0, 3, 2}, {3, 1, 2}},
                                                two[] = {{3, 1, 4}, {0, 3, 4}, {0, 4, 2}},
                                                other_two[] = {{3, 1, 4}, {0, 3, 2}, {3, 4, 2}},
                                                all[] = {
                                                    {0, 3, 5}, {3, 1, 4}, {5, 4, 2}, {3, 4, 5}};
            std::span<const std::array<int, 3>> parts = none;
            if (marked == 1) parts = one;
            if (marked == 2) parts = length(t[0], m[1]) < length(m[0], t[2]) ? two : other_two;
            if (marked == 3) parts = all;
            const std::array<std::int32_t, 6> rows{t[0], t[1], t[2], m[0], m[1], m[2]};
            for (const auto& [a, b, c] : parts) {
                for (const int k : {a, b, c}) cut.push_back(rows[std::size_t(k)]);
                if (cut.size() > 3 * max_samples) reject_as_too_many();
            }
        }
        made_.triangles = std::move(cut);
    }

    /// The row of the middle of a side, or -1 if it is not marked.
    std::int32_t middle(std::int32_t a, std::int32_t b) const {
        const auto found = middles_.find(side(a, b));
        return found == middles_.end() ? -1 : found->second;
    }

    [[noreturn]] static void reject_as_too_many() {
        reject("the samples of this mesh are more than " + std::to_string(max_samples) +
               ". Take them further apart, or render its triangles.");
    }

    double longest_side_, cover_;
    OwnedSurface made_;
    std::unordered_map<std::uint64_t, std::int32_t> middles_;  // of the sides to halve
};

VFPLAN_ONCE OwnedSurface sampled(const Surface& s, double cover,
                                 std::optional<double> longest_side) {
    // No place of a triangle is farther from its corners than its longest side over sqrt(3).
    return Refinement(s, longest_side.value_or(std::sqrt(3.0) * cover), cover).take();
}
#endif

}  // namespace vfplan::inline v1::mesh
