// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Values that must agree, because one is certified and another is rendered (docs/format.md,
// section 3): the points and the lines and arcs are one curve, the verdict on K is about the K of
// the file, and the registration is that of its markers and its points.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "vfplan/bundle/content.hpp"
#include "vfplan/bundle/finding.hpp"
#include "vfplan/bundle/text.hpp"

namespace vfplan::bundle::detail {

/// What two values that were computed in two ways may differ by [m].
inline constexpr double same_place_m = 1e-6;

/// A point of the plane across the ignored axis [m].
struct Flat {
    double x = 0, y = 0;
};

inline double distance(Flat a, Flat b) { return std::hypot(a.x - b.x, a.y - b.y); }

/// That plane, seen with the axis pointing to the viewer: x to the right, y upwards.
class ViewPlane {
  public:
    explicit ViewPlane(const std::vector<double>& axis) {
        // x is across the axis and the coordinate that is least along it.
        std::size_t least = 0;
        for (std::size_t k = 1; k < 3; ++k) {
            if (std::abs(axis[k]) < std::abs(axis[least])) least = k;
        }
        for (std::size_t k = 0; k < 3; ++k)
            x_[k] = (k == least ? 1.0 : 0.0) - axis[least] * axis[k];
        const double length = std::sqrt(x_[0] * x_[0] + x_[1] * x_[1] + x_[2] * x_[2]);
        for (double& part : x_) part /= length;
        for (std::size_t k = 0; k < 3; ++k) {
            const std::size_t i = (k + 1) % 3, j = (k + 2) % 3;
            y_[k] = axis[i] * x_[j] - axis[j] * x_[i];
        }
    }
    /// Point `i` of a table of coordinates.
    [[nodiscard]] Flat of(const std::vector<double>& points, std::size_t i) const {
        Flat flat;
        for (std::size_t k = 0; k < 3; ++k) {
            flat.x += x_[k] * points[3 * i + k];
            flat.y += y_[k] * points[3 * i + k];
        }
        return flat;
    }

  private:
    std::array<double, 3> x_{}, y_{};
};

/// A line or an arc from vertex to vertex.
class FlatPiece {
  public:
    FlatPiece(Flat from, Flat to, double bulge) : from_(from), to_(to) {
        const double chord = distance(from, to);
        // Below this an arc is as straight as rounding lets one tell.
        constexpr double straight = 1e-8;
        length_ = chord;
        if (std::abs(bulge) < straight || chord == 0) return;
        turn_ = bulge > 0 ? 1 : -1;
        radius_ = chord * (1 + bulge * bulge) / (4 * std::abs(bulge));
        sweep_ = 4 * std::atan(std::abs(bulge));
        length_ = radius_ * sweep_;
        const double offset = (1 - bulge * bulge) / (4 * bulge);  // of the centre, in chords
        centre_.x = (from.x + to.x) / 2 - offset * (to.y - from.y);
        centre_.y = (from.y + to.y) / 2 + offset * (to.x - from.x);
    }

    [[nodiscard]] double length() const { return length_; }

    /// Where on the piece a point is nearest, as the way from its first vertex, and how far away.
    struct Foot {
        double way, distance;
    };
    [[nodiscard]] Foot foot_of(Flat p) const {
        return turn_ == 0 ? foot_on_line(p) : foot_on_arc(p);
    }

  private:
    [[nodiscard]] Foot foot_on_line(Flat p) const {
        const double dx = to_.x - from_.x, dy = to_.y - from_.y, square = dx * dx + dy * dy;
        double share = 0;
        if (square > 0) {
            share = std::clamp(((p.x - from_.x) * dx + (p.y - from_.y) * dy) / square, 0.0, 1.0);
        }
        return {share * length_, distance(p, {from_.x + share * dx, from_.y + share * dy})};
    }
    [[nodiscard]] Foot foot_on_arc(Flat p) const {
        const double ax = from_.x - centre_.x, ay = from_.y - centre_.y;
        const double bx = p.x - centre_.x, by = p.y - centre_.y;
        double angle = std::atan2(turn_ * (ax * by - ay * bx), ax * bx + ay * by);
        if (angle < 0) angle += 2 * std::acos(-1.0);
        if (angle <= sweep_) return {radius_ * angle, std::abs(std::hypot(bx, by) - radius_)};
        const double first = distance(p, from_), last = distance(p, to_);
        return first <= last ? Foot{0, first} : Foot{length_, last};
    }

    Flat from_, to_, centre_;
    double length_ = 0, radius_ = 0, sweep_ = 0;
    int turn_ = 0;  // 1 to the left, -1 to the right, 0 a line
};

/// Follows a stroke's points along its pieces, in the order in which both were drawn.
///
/// Every point lies within `tolerance` of the pieces, and from each point to the next, and to the
/// ends, the way along the pieces is at most `longest_way`. So no part of the pieces is farther
/// from the points than the spacing that the leak certificate is about, and none is left out.
class Walk {
  public:
    Walk(const std::vector<FlatPiece>& pieces, bool closed, double tolerance, double longest_way)
        : pieces_(pieces), closed_(closed), tolerance_(tolerance), longest_way_(longest_way) {}

    /// How many of the points are followed, one after the other; all of them where the pieces lead
    /// there, and one more where they also end there.
    [[nodiscard]] std::size_t follow(const std::vector<Flat>& points) {
        if (!closed_) return follow_from({0, 0}, points);
        std::size_t followed = 0;
        for (const Place& start : starts(points.front())) {
            followed = std::max(followed, follow_from(start, points));
            if (followed > points.size()) break;
        }
        return followed;
    }

  private:
    /// A place on the pieces: which one, and the way from its first vertex [m].
    struct Place {
        std::size_t piece;
        double way;
    };

    /// Where a closed stroke may begin, as its first point does not say: several places where it
    /// crosses itself there.
    [[nodiscard]] std::vector<Place> starts(Flat first) const {
        // Two strands that cross meet in four pieces at most; a file with more is no drawn curve.
        constexpr std::size_t most = 8;
        std::vector<Place> places;
        for (std::size_t k = 0; k < pieces_.size() && places.size() < most; ++k) {
            const FlatPiece::Foot foot = pieces_[k].foot_of(first);
            if (foot.distance <= tolerance_) places.push_back({k, foot.way});
        }
        return places;
    }

    [[nodiscard]] std::size_t follow_from(Place start, const std::vector<Flat>& points) {
        at_ = start;
        pieces_left_ = pieces_.size();
        to_go_ = 0;
        for (const FlatPiece& piece : pieces_) to_go_ += piece.length();
        std::size_t followed = 0;
        while (followed < points.size() && advance(points[followed])) ++followed;
        return followed == points.size() && to_go_ <= longest_way_ ? followed + 1 : followed;
    }

    /// Goes on to the next point; false if the pieces do not lead there.
    [[nodiscard]] bool advance(Flat p) {
        const FlatPiece::Foot here = pieces_[at_.piece].foot_of(p);
        const double ahead = here.way - at_.way;
        if (here.distance <= tolerance_ && ahead >= -2 * tolerance_ && ahead <= longest_way_) {
            return move_to({at_.piece, here.way}, ahead);
        }
        double walked = pieces_[at_.piece].length() - at_.way;
        std::size_t k = at_.piece;
        while (walked <= longest_way_ && pieces_left_ > 0) {
            if (k + 1 == pieces_.size() && !closed_) return false;
            k = (k + 1) % pieces_.size();
            --pieces_left_;
            const FlatPiece::Foot foot = pieces_[k].foot_of(p);
            if (foot.distance <= tolerance_ && walked + foot.way <= longest_way_) {
                return move_to({k, foot.way}, walked + foot.way);
            }
            walked += pieces_[k].length();
        }
        return false;
    }

    bool move_to(Place place, double walked) {
        at_ = place;
        to_go_ -= walked;
        return true;
    }

    const std::vector<FlatPiece>& pieces_;
    bool closed_;
    double tolerance_, longest_way_;
    Place at_{0, 0};
    std::size_t pieces_left_ = 0;  // that may still be entered, each once
    double to_go_ = 0;             // along the pieces to their end [m]
};

/// The pieces of a stroke of so many vertices, from vertex `first` on.
inline std::vector<FlatPiece> flat_pieces(const std::vector<double>& vertices,
                                          const std::vector<double>& bulges, std::size_t first,
                                          std::size_t count, bool closed, const ViewPlane& plane) {
    std::vector<FlatPiece> pieces;
    for (std::size_t i = 0; i + 1 < count; ++i) {
        pieces.emplace_back(plane.of(vertices, first + i), plane.of(vertices, first + i + 1),
                            bulges[first + i]);
    }
    const std::size_t last = first + count - 1;
    if (closed) {
        pieces.emplace_back(plane.of(vertices, last), plane.of(vertices, first), bulges[last]);
    } else if (count == 1) {
        pieces.emplace_back(plane.of(vertices, first), plane.of(vertices, first), 0);
    }
    return pieces;
}

/// The points, which are certified, and the lines and arcs, which are rendered, are one curve.
inline void check_one_curve(const Content& content, Findings& findings) {
    if (!content.has_group("/pieces")) return;
    const ViewPlane plane(content.at("/rendering/ignore_axis").f8);
    const std::vector<double>& points = content.at("/points").f8;
    const std::vector<double>& vertices = content.at("/pieces/vertices").f8;
    const std::vector<double>& bulges = content.at("/pieces/bulges").f8;
    const std::vector<std::int32_t>& stroke_of_point = content.at("/curve/stroke").i4;
    const std::vector<std::int32_t>& stroke_of_vertex = content.at("/pieces/stroke").i4;
    const std::vector<std::uint8_t>& closed = content.at("/curve/closed").u1;
    const double tolerance = content.number("/pieces@error_m") + same_place_m;
    const double longest_way = 2 * (content.number("/leak@largest_m") + tolerance);
    std::size_t point = 0, vertex = 0;
    for (std::size_t s = 0; s < closed.size(); ++s) {
        const auto number = static_cast<std::int32_t>(s);
        const bool is_closed = closed[s] != 0;
        const std::size_t first_vertex = vertex, first_point = point;
        while (vertex < stroke_of_vertex.size() && stroke_of_vertex[vertex] == number) ++vertex;
        std::vector<Flat> places;
        while (point < stroke_of_point.size() && stroke_of_point[point] == number) {
            places.push_back(plane.of(points, point++));
        }
        const auto pieces =
            flat_pieces(vertices, bulges, first_vertex, vertex - first_vertex, is_closed, plane);
        const std::size_t followed = Walk(pieces, is_closed, tolerance, longest_way).follow(places);
        if (followed > places.size()) continue;
        const std::string where = followed == places.size()
                                      ? "go on behind the points of stroke " + std::to_string(s)
                                      : "do not lead to point " +
                                            std::to_string(first_point + followed) +
                                            " within error_m";
        return findings.error("unsafe.pieces", "/pieces",
                              where + ": what is rendered is not what is certified");
    }
}

/// Every point is a corner of a triangle: who renders the points renders nothing else.
inline void check_corners(const Content& content, Findings& findings) {
    if (!content.has("/mesh/triangles")) return;
    std::vector<bool> used(content.at("/points").shape[0], false);
    for (const std::int32_t row : content.at("/mesh/triangles").i4) {
        used[static_cast<std::size_t>(row)] = true;
    }
    const auto free = std::find(used.begin(), used.end(), false);
    findings.require(free == used.end(), "unsafe.mesh", "/mesh/triangles",
                     "leaves out point " + std::to_string(free - used.begin()) +
                         ": what is certified is not all that is rendered");
}

/// The largest eigenvalue of P K P, where P takes away the part along the ignored axis: the most
/// that the force grows with the depth, in any direction [N/m]. By Jacobi's rotations.
inline double largest_stiffness(const Content& content) {
    const std::vector<double>& K = content.at("/rendering/stiffness").f8;
    std::array<double, 3> axis{};
    if (const Value* given = content.find("/rendering/ignore_axis")) {
        std::copy_n(given->f8.begin(), 3, axis.begin());
    }
    std::array<std::array<double, 3>, 3> m{};
    for (std::size_t i = 0; i < 3; ++i) {
        for (std::size_t j = 0; j < 3; ++j) {
            for (std::size_t k = 0; k < 3; ++k) {
                const double left = (i == k ? 1.0 : 0.0) - axis[i] * axis[k];
                const double right = (k == j ? 1.0 : 0.0) - axis[k] * axis[j];
                m[i][j] += left * K[k] * right;
            }
        }
    }
    constexpr int sweeps = 30;  // three or four reach the last bit
    for (int sweep = 0; sweep < sweeps; ++sweep) {
        for (const auto& [p, q] : {std::pair<std::size_t, std::size_t>{0, 1}, {0, 2}, {1, 2}}) {
            if (m[p][q] == 0) continue;
            const double angle = 0.5 * std::atan2(2 * m[p][q], m[q][q] - m[p][p]);
            const double c = std::cos(angle), s = std::sin(angle);
            for (std::size_t k = 0; k < 3; ++k) {
                const double kp = m[k][p], kq = m[k][q];
                m[k][p] = c * kp - s * kq;
                m[k][q] = s * kp + c * kq;
            }
            for (std::size_t k = 0; k < 3; ++k) {
                const double pk = m[p][k], qk = m[q][k];
                m[p][k] = c * pk - s * qk;
                m[q][k] = s * pk + c * qk;
            }
        }
    }
    return std::max({m[0][0], m[1][1], m[2][2]});
}

/// The verdict of the stability gate is about the K of this file, and says that it is stable.
inline void check_stability(const Content& content, Findings& findings) {
    const bool named = content.has("/rendering@robot"),
               judged = content.has("/rendering/stability");
    findings.require(named == judged, "corrupt.missing", "/rendering",
                     "robot and stability need each other");
    if (!judged || !content.has("/rendering/stiffness")) return;
    double wanted = largest_stiffness(content);
    if (const Value* guide = content.find("/guidance@stiffness_n_per_m")) {
        // A guide is a spring as well; beside a forbidden region both may press at once.
        const bool forbids = content.has("/guidance@stroke");
        wanted = guide->number() + (forbids ? wanted : 0);
    }
    const std::vector<double>& verdict = content.at("/rendering/stability").f8;
    const double K = verdict[4], largest_stable = verdict[5], margin = verdict[6];
    constexpr double rounding = 1e-6;
    findings.require(std::abs(K - wanted) <= rounding * wanted, "unsafe.stability",
                     "/rendering/stability",
                     "judges K = " + shown(K) + " N/m; the fixture renders " + shown(wanted));
    findings.require(K * margin <= largest_stable * (1 + rounding), "unsafe.stability",
                     "/rendering/stability",
                     "judges K = " + shown(K) + " N/m with a margin of " + shown(margin) +
                         ", and only " + shown(largest_stable) + " is stable");
}

/// The transform's value at a row of the source: (u, v) of a slice, or (x, y, z).
inline std::array<double, 3> carried(const Value& transform, const double* source) {
    const std::size_t side = transform.shape[0];
    std::array<double, 3> out{};
    for (std::size_t i = 0; i < 3; ++i) {
        const double* row = transform.f8.data() + side * i;
        out[i] = row[side - 1];
        for (std::size_t j = 0; j + 1 < side; ++j) out[i] += row[j] * source[j];
    }
    return out;
}

/// The registration is that of its markers; what comes from a slice lies in the plane to which it
/// takes the slice.
inline void check_registered(const Content& content, Findings& findings) {
    if (!content.has_group("/registration")) return;
    const Value& transform = content.at("/registration/T_robot_image");
    const Value& source = content.at("/registration/source");
    const std::vector<double>& target = content.at("/registration/target").f8;
    const std::vector<double>& residuals = content.at("/registration/residuals").f8;
    double worst = 0;
    for (std::size_t i = 0; i < residuals.size(); ++i) {
        const auto place = carried(transform, source.f8.data() + source.shape[1] * i);
        double square = 0;
        for (std::size_t k = 0; k < 3; ++k) square += std::pow(place[k] - target[3 * i + k], 2);
        worst = std::max(worst, std::abs(std::sqrt(square) - residuals[i]));
    }
    findings.require(worst <= same_place_m, "unsafe.registration", "/registration/residuals",
                     "differ by up to " + shown(worst) + " m from what transform and markers give");
    if (transform.shape[0] != 3) return;
    const std::vector<double>& T = transform.f8;
    std::array<double, 3> normal{};
    double square = 0;
    for (std::size_t k = 0; k < 3; ++k) {
        const std::size_t i = (k + 1) % 3, j = (k + 2) % 3;
        normal[k] = T[3 * i] * T[3 * j + 1] - T[3 * j] * T[3 * i + 1];
        square += normal[k] * normal[k];
    }
    if (square == 0) return;
    const std::vector<double>& points = content.at("/points").f8;
    double farthest = 0;
    for (std::size_t i = 0; i < points.size(); i += 3) {
        double height = 0;
        for (std::size_t k = 0; k < 3; ++k) height += normal[k] * (points[i + k] - T[3 * k + 2]);
        farthest = std::max(farthest, std::abs(height));
    }
    farthest /= std::sqrt(square);
    findings.require(farthest <= same_place_m, "unsafe.registration", "/points",
                     "lie up to " + shown(farthest) +
                         " m from the plane to which the registration takes the slice");
}

}  // namespace vfplan::bundle::detail
