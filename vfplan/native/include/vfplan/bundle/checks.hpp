// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// What ties the values of a bundle together: points and pieces that agree, and the rules of the
// format. The leak certificate stands in leak.hpp.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "vfplan/base/vec.hpp"
#include "vfplan/bundle/bytes.hpp"
#include "vfplan/bundle/content.hpp"
#include "vfplan/bundle/leak.hpp"
#include "vfplan/bundle/schema.hpp"
#include "vfplan/bundle/seal.hpp"

namespace vfplan::bundle::detail {

// Values that must agree, because one is certified and another is rendered (docs/format.md,
// section 3): the points and the lines and arcs are one curve, the verdict on K is about the K of
// the file, and the registration is that of its markers and its points.

/// What two values that were computed in two ways may differ by [m].
inline constexpr double same_place_m = 1e-6;

/// How far points and pieces may be apart, as a share of R and in metres: what is certified,
/// approved and rendered is one curve.
inline constexpr double max_error_of_radius = 0.01, max_error_m = 1e-4;

/// Point `i` of a table of coordinates in the plane across the ignored axis, which is seen with the
/// axis pointing to the viewer [m].
inline Vec2 flat_point(const Slice& plane, const std::vector<double>& points, std::size_t i) {
    return plane.project({{points[3 * i], points[3 * i + 1], points[3 * i + 2]}});
}

/// A line or an arc from vertex to vertex.
class FlatPiece {
  public:
    FlatPiece(Vec2 from, Vec2 to, double bulge) : from_(from), to_(to) {
        const double chord = norm(to - from);
        // Below this an arc is as straight as rounding lets one tell.
        constexpr double straight = 1e-8;
        length_ = chord;
        if (std::abs(bulge) < straight || chord == 0) return;
        turn_ = bulge > 0 ? 1 : -1;
        radius_ = chord * (1 + bulge * bulge) / (4 * std::abs(bulge));
        sweep_ = 4 * std::atan(std::abs(bulge));
        length_ = radius_ * sweep_;
        const double offset = (1 - bulge * bulge) / (4 * bulge);  // of the centre, in chords
        const Vec2 left{{from[1] - to[1], to[0] - from[0]}};
        centre_ = 0.5 * (from + to) + offset * left;
    }

    [[nodiscard]] double length() const { return length_; }
    [[nodiscard]] bool is_straight() const { return turn_ == 0; }
    [[nodiscard]] double radius() const { return is_straight() ? infinity : radius_; }
    [[nodiscard]] Vec2 end() const { return to_; }

    /// The place that lies so far along the piece from its first vertex.
    [[nodiscard]] Vec2 place_at(double way) const {
        if (is_straight()) return from_ + (length_ > 0 ? way / length_ : 0) * (to_ - from_);
        const double angle = turn_ * way / radius_, c = std::cos(angle), s = std::sin(angle);
        const Vec2 a = from_ - centre_;
        return centre_ + Vec2{{c * a[0] - s * a[1], s * a[0] + c * a[1]}};
    }

    /// Where on the piece a point is nearest, as the way from its first vertex, and how far away.
    struct Foot {
        double way, distance;
    };
    [[nodiscard]] Foot foot_of(Vec2 p) const {
        return is_straight() ? foot_on_line(p) : foot_on_arc(p);
    }

  private:
    [[nodiscard]] Foot foot_on_line(Vec2 p) const {
        const Vec2 chord = to_ - from_;
        const double square = dot(chord, chord);
        double share = 0;
        if (square > 0) share = std::clamp(dot(p - from_, chord) / square, 0.0, 1.0);
        return {share * length_, norm(p - (from_ + share * chord))};
    }
    [[nodiscard]] Foot foot_on_arc(Vec2 p) const {
        const Vec2 a = from_ - centre_, b = p - centre_;
        double angle = std::atan2(turn_ * (a[0] * b[1] - a[1] * b[0]), dot(a, b));
        if (angle < 0) angle += 2 * std::acos(-1.0);
        if (angle <= sweep_) return {radius_ * angle, std::abs(norm(b) - radius_)};
        const double first = norm(p - from_), last = norm(p - to_);
        return first <= last ? Foot{0, first} : Foot{length_, last};
    }

    Vec2 from_, to_, centre_;
    double length_ = 0, radius_ = 0, sweep_ = 0;
    int turn_ = 0;  // 1 to the left, -1 to the right, 0 a line
};

/// How far points and pieces may be apart, and the way from a point to the next be long [m].
struct Apart {
    double tolerance;    // of a point from the pieces
    double slack;        // of the pieces from the line between two points, where these do not turn
    double longest_way;  // from a point to the next along the pieces
};

/// Follows a stroke's points along its pieces, in the order in which both were drawn.
///
/// Every point lies within the tolerance of the pieces. From each point to the next the pieces keep
/// to the line between the two, but for the slack and what the points' own turns allow. The pieces
/// begin at the first point and end at the last, in a closed stroke at the first again.
class Walk {
  public:
    Walk(const std::vector<FlatPiece>& pieces, const std::vector<Vec2>& points, bool closed,
         const Apart& apart)
        : pieces_(pieces), points_(points), closed_(closed), apart_(apart) {}

    /// How many of the points are followed, one after the other; all of them where the pieces lead
    /// there, and one more where they also end there.
    [[nodiscard]] std::size_t follow() {
        if (!closed_) return follow_from({0, 0});
        std::size_t followed = 0;
        for (const Place& start : starts(points_.front())) {
            followed = std::max(followed, follow_from(start));
            if (followed > points_.size()) break;
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
    [[nodiscard]] std::vector<Place> starts(Vec2 first) const {
        // Two strands that cross meet in four pieces at most; a file with more is no drawn curve.
        constexpr std::size_t max_places = 8;
        std::vector<Place> places;
        for (std::size_t k = 0; k < pieces_.size() && places.size() < max_places; ++k) {
            const FlatPiece::Foot foot = pieces_[k].foot_of(first);
            if (foot.distance <= apart_.tolerance) places.push_back({k, foot.way});
        }
        return places;
    }

    [[nodiscard]] std::size_t follow_from(Place start) {
        at_ = start;
        pieces_left_ = pieces_.size();
        to_go_ = 0;
        for (const FlatPiece& piece : pieces_) to_go_ += piece.length();
        // A closed stroke leads back to its first point.
        const std::size_t steps = points_.size() + (closed_ ? 1 : 0);
        std::size_t followed = 0;
        while (followed < steps && advance(followed)) ++followed;
        if (followed < steps) return std::min(followed, points_.size() - 1);
        return to_go_ <= end_slack() ? points_.size() + 1 : points_.size();
    }

    /// How far the pieces may begin before the first point, and end behind the last [m].
    [[nodiscard]] double end_slack() const { return apart_.slack + apart_.tolerance; }

    /// Goes on to point `i`; false if the pieces do not lead there, or not along the points.
    [[nodiscard]] bool advance(std::size_t i) {
        const double longest_way = i > 0 ? apart_.longest_way : end_slack();
        const double tolerance = apart_.tolerance;
        next_ = i;
        const Vec2 to = point(i);
        const FlatPiece::Foot here = pieces_[at_.piece].foot_of(to);
        const double ahead = here.way - at_.way;
        if (here.distance <= tolerance && ahead >= -2 * tolerance && ahead <= longest_way) {
            // Both ends of the part are within the tolerance of the points; how far its middle may
            // be beside them follows from the arc. This is so for most steps.
            const bool is_flat = ahead * ahead <= 8 * apart_.slack * pieces_[at_.piece].radius();
            return (is_flat || keeps_to_line(at_.piece, at_.way, here.way)) &&
                   move_to({at_.piece, here.way}, ahead);
        }
        double walked = pieces_[at_.piece].length() - at_.way;
        std::size_t k = at_.piece;
        double from_way = at_.way;
        while (walked <= longest_way && pieces_left_ > 0) {
            if (!keeps_to_line(k, from_way, pieces_[k].length()) || !is_near(pieces_[k].end()) ||
                (k + 1 == pieces_.size() && !closed_)) {
                return false;
            }
            k = (k + 1) % pieces_.size();
            from_way = 0;
            --pieces_left_;
            const FlatPiece::Foot foot = pieces_[k].foot_of(to);
            if (foot.distance <= tolerance && walked + foot.way <= longest_way) {
                return keeps_to_line(k, 0, foot.way) && move_to({k, foot.way}, walked + foot.way);
            }
            walked += pieces_[k].length();
        }
        return false;
    }

    /// The point that a step leads to, in a closed stroke at last the first again.
    [[nodiscard]] Vec2 point(std::size_t i) const { return points_[i < points_.size() ? i : 0]; }

    /// Tangent of the angle by which the points turn at one of them, which is taken as 60 degrees
    /// at most. The ends of an open stroke do not turn.
    [[nodiscard]] double turn_at(std::size_t i) const {
        const std::size_t count = points_.size();
        if (!closed_ && (i == 0 || i + 1 == count)) return 0;
        const Vec2 here = point(i);
        const Vec2 in = here - points_[(i + count - 1) % count];
        const Vec2 out = points_[(i + 1) % count] - here;
        const double along = dot(in, out), aside = std::abs(in[0] * out[1] - in[1] * out[0]);
        const double most = std::sqrt(3.0);
        return aside < most * along ? aside / along : most;
    }

    /// Whether a place is near enough to the line from the last point to the next. The first point
    /// of an open stroke has none before it: there the way is short.
    [[nodiscard]] bool is_near(Vec2 place) const {
        if (next_ == 0) return true;
        const Vec2 from = point(next_ - 1), to = point(next_);
        const double turn = std::max(turn_at(next_ - 1), turn_at(next_));
        const double leeway = end_slack() + 0.5 * norm(to - from) * turn;
        return FlatPiece(from, to, 0).foot_of(place).distance <= leeway;
    }

    /// Whether a part of a piece, whose ends are near that line, is near it in its middle as well.
    [[nodiscard]] bool keeps_to_line(std::size_t piece, double from, double to) const {
        return pieces_[piece].is_straight() || is_near(pieces_[piece].place_at(0.5 * (from + to)));
    }

    bool move_to(Place place, double walked) {
        at_ = place;
        to_go_ -= walked;
        return true;
    }

    const std::vector<FlatPiece>& pieces_;
    const std::vector<Vec2>& points_;
    bool closed_;
    Apart apart_;
    Place at_{0, 0};
    std::size_t next_ = 0;         // number of the point that the step leads to
    std::size_t pieces_left_ = 0;  // that may still be entered, each once
    double to_go_ = 0;             // along the pieces to their end [m]
};

/// The pieces of a stroke of so many vertices, from vertex `first` on.
inline std::vector<FlatPiece> flat_pieces(const std::vector<double>& vertices,
                                          const std::vector<double>& bulges, std::size_t first,
                                          std::size_t count, bool closed, const Slice& plane) {
    std::vector<FlatPiece> pieces;
    for (std::size_t i = 0; i + 1 < count; ++i) {
        pieces.emplace_back(flat_point(plane, vertices, first + i),
                            flat_point(plane, vertices, first + i + 1), bulges[first + i]);
    }
    const std::size_t last = first + count - 1;
    if (closed) {
        pieces.emplace_back(flat_point(plane, vertices, last), flat_point(plane, vertices, first),
                            bulges[last]);
    } else if (count == 1) {
        pieces.emplace_back(flat_point(plane, vertices, first), flat_point(plane, vertices, first),
                            0);
    }
    return pieces;
}

/// The points, which are certified, and the lines and arcs, which are rendered, are one curve.
inline void check_one_curve(const Content& content, Findings& findings) {
    if (!content.has_group("/pieces")) return;
    const std::vector<double>& axis = content.at("/rendering/ignore_axis").f8;
    const Slice plane(Vec3{{axis[0], axis[1], axis[2]}});
    const std::vector<double>& points = content.at("/points").f8;
    const std::vector<double>& vertices = content.at("/pieces/vertices").f8;
    const std::vector<double>& bulges = content.at("/pieces/bulges").f8;
    const std::vector<std::int32_t>& stroke_of_point = content.at("/curve/stroke").i4;
    const std::vector<std::int32_t>& stroke_of_vertex = content.at("/pieces/stroke").i4;
    const std::vector<std::uint8_t>& closed = content.at("/curve/closed").u1;
    const double error = content.number("/pieces@error_m");
    const double radius =
        content.number("/rendering@contact_radius_m") + content.number("/rendering@point_radius_m");
    const double max_error = std::min(max_error_of_radius * radius, max_error_m);
    if (error > max_error) {
        return findings.error(
            "unsafe.pieces", "/pieces@error_m",
            {"is ", error, " m; at most ", max_error, " m allowed where R is ", radius, " m"},
            "Fit the pieces more closely, or leave them out");
    }
    const double tolerance = error + same_place_m;
    const Apart apart{tolerance, max_error, 2 * (content.number("/leak@largest_m") + tolerance)};
    std::size_t point = 0, vertex = 0;
    for (std::size_t s = 0; s < closed.size(); ++s) {
        const auto number = static_cast<std::int32_t>(s);
        const bool is_closed = closed[s] != 0;
        const std::size_t first_vertex = vertex, first_point = point;
        while (vertex < stroke_of_vertex.size() && stroke_of_vertex[vertex] == number) ++vertex;
        std::vector<Vec2> places;
        while (point < stroke_of_point.size() && stroke_of_point[point] == number) {
            places.push_back(flat_point(plane, points, point++));
        }
        const auto pieces =
            flat_pieces(vertices, bulges, first_vertex, vertex - first_vertex, is_closed, plane);
        const std::size_t followed = Walk(pieces, places, is_closed, apart).follow();
        if (followed > places.size()) continue;
        std::string where = "go on behind the points of stroke " + std::to_string(s);
        if (followed < places.size()) {
            where = "do not lead to point " + std::to_string(first_point + followed) +
                    " along the points, within error_m";
        }
        return findings.error("unsafe.pieces", "/pieces",
                              {where, ": what is rendered is not what is certified"},
                              "Change both together, or leave the pieces out");
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
                     {"leaves out point ", free - used.begin(),
                      ": what is certified is not all that is rendered"},
                     "Leave the point out, or give it a triangle");
}

/// The largest eigenvalue of P K P, where P takes away the part along the ignored axis: the most
/// that the force grows with the depth, in any direction [N/m].
inline double largest_stiffness(const Content& content) {
    const std::vector<double>& K = content.at("/rendering/stiffness").f8;
    const Value* axis = content.find("/rendering/ignore_axis");
    if (axis == nullptr) return std::max({K[0], K[1], K[2]});
    // One eigenvalue is 0. The trace is the sum of the two others, and the elements' squares add up
    // to the sum of theirs.
    const std::vector<double>& a = axis->f8;
    double trace = 0, squares = 0;
    for (std::size_t i = 0; i < 3; ++i) {
        for (std::size_t j = 0; j < 3; ++j) {
            double element = 0;
            for (std::size_t k = 0; k < 3; ++k)
                element += ((i == k) - a[i] * a[k]) * K[k] * ((k == j) - a[k] * a[j]);
            if (i == j) trace += element;
            squares += element * element;
        }
    }
    return (trace + std::sqrt(std::max(0.0, 2 * squares - trace * trace))) / 2;
}

/// The verdict of the stability gate is about the K of this file, and says that it is stable.
inline void check_stability(const Content& content, Findings& findings) {
    const bool named = content.has("/rendering@robot"),
               judged = content.has("/rendering/stability");
    findings.require(named == judged, "corrupt.missing", "/rendering",
                     {"has one of robot and stability, which need each other"},
                     "Write both or neither");
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
                     {"judges K = ", K, " N/m; the fixture renders ", wanted});
    findings.require(K * margin <= largest_stable * (1 + rounding), "unsafe.stability",
                     "/rendering/stability",
                     {"judges K = ", K, " N/m with a margin of ", margin, ", and only ",
                      largest_stable, " is stable"});
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
                     {"differ by up to ", worst, " m from what transform and markers give"});
    if (transform.shape[0] != 3) return;
    const std::vector<double>& T = transform.f8;
    std::array<double, 3> normal{};
    double square = 0;
    for (std::size_t k = 0; k < 3; ++k) {
        const std::size_t i = (k + 1) % 3, j = (k + 2) % 3;
        normal[k] = T[3 * i] * T[3 * j + 1] - T[3 * j] * T[3 * i + 1];
        square += normal[k] * normal[k];
    }
    if (square == 0) {
        return findings.error("unsafe.registration", "/registration/T_robot_image",
                              {"takes the slice to a line: its first two columns are parallel"},
                              "Register it with markers that lie on no line");
    }
    const std::vector<double>& points = content.at("/points").f8;
    double farthest = 0;
    for (std::size_t i = 0; i < points.size(); i += 3) {
        double height = 0;
        for (std::size_t k = 0; k < 3; ++k) height += normal[k] * (points[i + k] - T[3 * k + 2]);
        farthest = std::max(farthest, std::abs(height));
    }
    farthest /= std::sqrt(square);
    findings.require(
        farthest <= same_place_m, "unsafe.registration", "/points",
        {"lie up to ", farthest, " m from the plane to which the registration takes the slice"});
}

}  // namespace vfplan::bundle::detail

namespace vfplan::bundle {

// Rules that tie several values together, in the order of docs/format.md.

namespace detail {

inline void check_understood(const Content& content, Findings& findings) {
    if (!content.has("/@must_understand")) return;
    const std::string& text = content.at("/@must_understand").string();
    for (std::size_t start = 0; start <= text.size();) {
        const std::size_t end = std::min(text.find(' ', start), text.size());
        const std::string path = text.substr(start, end - start);
        findings.require(path.empty() || is_known(path), "version.must_understand", path,
                         {"must be understood, and this program does not"},
                         "Get a program that does: pip install --upgrade vfplan");
        start = end + 1;
    }
}

/// Which groups a frame has no place for.
inline void check_groups(const Content& content, Findings& findings) {
    using Frames = std::initializer_list<std::string_view>;
    const std::string& frame = content.at("/@frame").string();
    const auto allow = [&](std::string_view group, Frames frames) {
        findings.require(!content.has_group(group) ||
                             std::find(frames.begin(), frames.end(), frame) != frames.end(),
                         "corrupt.group", group, {"must not be in the frame ", Quoted{frame}},
                         "Leave the group out");
    };
    allow("/image", {"image", "robot_base"});
    allow("/rendering", {"robot_base", "patient_lps"});
    allow("/guidance", {"robot_base", "patient_lps"});
    allow("/registration", {"robot_base"});
    allow("/mesh", {"robot_base", "patient_lps"});
    findings.require(!content.has_group("/mesh") || !content.has_group("/curve"), "corrupt.group",
                     "/mesh", {"must not stand beside /curve"}, "Leave one of them out");
}

inline void check_frames(const Content& content, Findings& findings) {
    const std::vector<double>& points = content.at("/points").f8;
    if (content.at("/@frame").string() != "image") return;
    bool flat = true;
    for (std::size_t i = 2; i < points.size(); i += 3) flat = flat && points[i] == 0;
    findings.require(flat, "corrupt.value", "/points",
                     {"has a third column that is not 0, in the frame image"}, "Write 0 there");
}

/// The SHA-256 of the geometry, of which the id is the beginning.
inline Digest geometry_digest(const Content& content) {
    const std::string& frame = content.at("/@frame").string();
    const std::vector<double>& points = content.at("/points").f8;
    const auto bytes = [](const auto& numbers) {
        return View(reinterpret_cast<const unsigned char*>(numbers.data()),
                    numbers.size() * sizeof(numbers[0]));
    };
    Sha256 sum;
    sum.update({reinterpret_cast<const unsigned char*>(frame.c_str()), frame.size() + 1});
    sum.update(bytes(points));
    if (const Value* mesh = content.find("/mesh/triangles")) sum.update(bytes(mesh->i4));
    if (const Value* vertices = content.find("/pieces/vertices")) {
        sum.update(bytes(vertices->f8));
        sum.update(bytes(content.at("/pieces/bulges").f8));
        sum.update(bytes(content.at("/pieces/stroke").i4));
    }
    return sum.digest();
}

inline void check_identity(const Content& content, const Digest& geometry, Findings& findings) {
    const std::string& found = content.at("/@id").string();
    const std::string wanted = to_hex(view(geometry)).substr(0, 32);
    findings.require(found == wanted, "corrupt.id", "/@id",
                     {"is ", Quoted{found}, "; the geometry gives ", Quoted{wanted}});
}

/// Whether these are 0, ..., 0, 1, ..., 1, 2, ...
inline bool counts_up(const std::vector<std::int32_t>& stroke) {
    const auto jump = std::adjacent_find(
        stroke.begin(), stroke.end(),
        [](std::int64_t one, std::int64_t next) { return next != one && next != one + 1; });
    return stroke.front() == 0 && jump == stroke.end();
}

inline void check_curve(const Content& content, Findings& findings) {
    const std::vector<std::int32_t>& stroke = content.at("/curve/stroke").i4;
    if (!counts_up(stroke)) {
        return findings.error("corrupt.value", "/curve/stroke",
                              {"does not count 0, 1, ... along the points"},
                              "Number the strokes in the order of their points");
    }
    const std::size_t strokes = content.at("/curve/closed").u1.size();
    const auto found = static_cast<std::size_t>(stroke.back()) + 1;
    findings.require(found == strokes, "corrupt.shape", "/curve/closed",
                     {"has ", strokes, " strokes; the points have ", found});
}

inline void check_pieces(const Content& content, Findings& findings) {
    if (!content.has_group("/pieces")) return;
    if (!content.has("/curve/closed") || !content.has("/rendering/ignore_axis")) {
        return findings.error("corrupt.group", "/pieces",
                              {"needs /curve and /rendering/ignore_axis"},
                              "Write these, or leave the group out");
    }
    const std::vector<std::int32_t>& stroke = content.at("/pieces/stroke").i4;
    const std::size_t strokes = content.at("/curve/closed").u1.size();
    findings.require(
        counts_up(stroke) && static_cast<std::size_t>(stroke.back()) + 1 == strokes,
        "corrupt.value", "/pieces/stroke",
        {"does not count 0, 1, ... to the ", strokes, " strokes of /curve along the vertices"},
        "Number the strokes in the order of their vertices");
}

inline void check_mesh(const Content& content, Findings& findings) {
    const std::vector<std::int32_t>& triangles = content.at("/mesh/triangles").i4;
    const std::int32_t highest = *std::max_element(triangles.begin(), triangles.end());
    const std::size_t count = content.at("/points").shape[0];
    findings.require(static_cast<std::size_t>(highest) < count, "corrupt.value", "/mesh/triangles",
                     {"names point ", highest, " of ", count, ", which are numbered from 0"},
                     "Name points that are there");
}

inline void check_rendering(const Content& content, Findings& findings) {
    if (const Value* axis = content.find("/rendering/ignore_axis")) {
        const std::vector<double>& a = axis->f8;
        const double length = std::sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
        findings.require(std::abs(length - 1) <= 1e-9, "corrupt.value", "/rendering/ignore_axis",
                         {"has length ", length, "; 1 wanted"}, "Divide it by its length");
    }
    const double radius =
        content.number("/rendering@contact_radius_m") + content.number("/rendering@point_radius_m");
    findings.require(
        content.number("/rendering@band_m") < radius, "corrupt.value", "/rendering@band_m",
        {"is ", content.number("/rendering@band_m"), " m; less than R = ", radius, " m wanted"},
        "Write a narrower band");
}

inline void check_guidance(const Content& content, Findings& findings) {
    if (!content.has_group("/guidance")) return;
    for (const std::string_view group : {"/curve", "/rendering"}) {
        findings.require(content.has_group(group), "corrupt.group", "/guidance", {"needs ", group},
                         "Write that group, or leave this one out");
    }
    const Value* named = content.find("/@must_understand");
    findings.require(
        named != nullptr && (" " + named->string() + " ").find(" /guidance ") != std::string::npos,
        "corrupt.missing", "/@must_understand", {"does not name /guidance"},
        "Name it, so that no reader forbids what is to guide");
    const Value* stroke = content.find("/guidance@stroke");
    if (stroke == nullptr) return;
    const auto strokes = static_cast<std::int64_t>(content.at("/curve/closed").u1.size());
    findings.require(stroke->i4.front() < strokes && strokes >= 2, "corrupt.value",
                     "/guidance@stroke",
                     {"is ", stroke->i4.front(), "; ", strokes,
                      " strokes leave no forbidden region beside such a one"},
                     "Name a stroke that is there beside others, or leave it out");
}

inline void check_unique(const std::vector<std::string>& names, std::string_view path,
                         Findings& findings) {
    const std::set<std::string_view> different(names.begin(), names.end());
    findings.require(different.size() == names.size() && !different.contains(""), "corrupt.value",
                     path, {"has a text that is empty, or there twice"},
                     "Give each a name of its own");
}

inline void check_registration(const Content& content, Findings& findings) {
    const bool from_image = content.at("/registration@source_frame").string() == "image";
    const Value& transform = content.at("/registration/T_robot_image");
    const std::size_t columns = content.at("/registration/source").shape[1];
    const std::vector<double>& t = transform.f8;
    if (transform.shape[0] != (from_image ? 3 : 4) || columns != (from_image ? 2 : 3)) {
        findings.error("corrupt.shape", "/registration",
                       {"T_robot_image has ", transform.shape[0], " rows and source ", columns,
                        " columns; 3 and 2 wanted from the frame image, else 4 and 3"});
    } else if (!from_image && (t[12] != 0 || t[13] != 0 || t[14] != 0 || t[15] != 1)) {
        findings.error("corrupt.value", "/registration/T_robot_image",
                       {"has another last row than 0 0 0 1"}, "Write that row");
    }
    if (const Value* covariance = content.find("/registration/covariance")) {
        const std::size_t side = covariance->shape[0];
        const std::size_t parameters = 3 * transform.shape[0];
        findings.require(side == parameters, "corrupt.shape", "/registration/covariance",
                         {"has ", side, " rows; ", parameters,
                          " wanted, as many as the transform has parameters"});
        bool negative = false;
        for (std::size_t i = 0; i < side; ++i) {
            negative = negative || covariance->f8[i * side + i] < 0;
        }
        findings.require(!negative, "corrupt.value", "/registration/covariance",
                         {"has a negative variance"}, "Compute it anew: a variance is 0 or more");
    }
    check_unique(content.at("/registration/labels").text, "/registration/labels", findings);
}

/// Places and answers come in pairs; a finding without one has zeros, or empty texts.
inline void check_findings(const Content& content, Findings& findings) {
    if (!content.has_group("/findings")) return;
    for (const std::string_view path : {"/findings/code", "/findings/stage"}) {
        const std::vector<std::string>& names = content.at(path).text;
        findings.require(
            std::all_of(names.begin(), names.end(), is_name), "corrupt.value", path,
            {"holds a name with other characters than letters, digits, '_', '.' and '-'"},
            "Write names of these");
    }
    for (const auto& [flag, place] : {std::pair{"/findings/has_place_px", "/findings/place_px"},
                                      std::pair{"/findings/has_place_m", "/findings/place_m"}}) {
        findings.require(content.has(flag) == content.has(place), "corrupt.missing", "/findings",
                         {"has one of ", flag, " and ", place, ", which need each other"},
                         "Write both or neither");
        if (!content.has(flag) || !content.has(place)) continue;
        const std::vector<std::uint8_t>& there = content.at(flag).u1;
        const std::vector<double>& places = content.at(place).f8;
        const std::size_t columns = places.size() / there.size();
        bool zeros = true;
        for (std::size_t i = 0; i < places.size(); ++i) {
            zeros = zeros && (there[i / columns] != 0 || places[i] == 0);
        }
        findings.require(zeros, "corrupt.value", place, {"holds a place of a finding without one"},
                         "Write zeros there");
    }
    findings.require(!content.has("/findings/place_m") || content.at("/@frame").string() != "image",
                     "corrupt.group", "/findings/place_m", {"must not be in the frame 'image'"},
                     "Leave it out");
    const Value *by = content.find("/findings/answered_by"),
                *when = content.find("/findings/answered_utc");
    findings.require((by == nullptr) == (when == nullptr), "corrupt.missing", "/findings",
                     {"has one of answered_by and answered_utc, which need each other"},
                     "Write both or neither");
    if (by == nullptr || when == nullptr) return;
    for (std::size_t i = 0; i < by->text.size(); ++i) {
        const std::string& time = when->text[i];
        const bool answered = !by->text[i].empty();
        findings.require(
            answered ? is_utc_time(time) : time.empty(), "corrupt.value", "/findings/answered_utc",
            {"is ", Quoted{time}, "; ", answered ? "YYYY-MM-DDThh:mm:ssZ" : "nothing", " wanted"});
        findings.require(!answered || is_plain(by->text[i]), "corrupt.value",
                         "/findings/answered_by",
                         {"is ", Quoted{by->text[i]}, "; text wanted that can be read off a page"},
                         "Write who answered it, without hidden characters");
    }
}

inline void check_review(const Content& content, Findings& findings) {
    if (!content.has_group("/review")) return;
    const std::string &by = content.at("/review@by").string(),
                      &time = content.at("/review@utc").string(),
                      &digest = content.at("/review@digest").string();
    findings.require(is_plain(by), "corrupt.value", "/review@by",
                     {"is ", Quoted{by}, "; text wanted that can be read off a page"},
                     "Write who reviewed it, without hidden characters");
    findings.require(is_utc_time(time), "corrupt.value", "/review@utc",
                     {"is ", Quoted{time}, "; YYYY-MM-DDThh:mm:ssZ wanted"});
    findings.require(is_sha256(digest), "corrupt.value", "/review@digest",
                     {"is ", Quoted{digest}, "; 64 hexadecimal digits wanted"});
}

/// The digest of everything that is rendered or reviewed (docs/format.md, section 3).
inline std::string review_digest(const Content& content, const Digest& geometry) {
    constexpr std::array<std::string_view, 5> in_geometry{
        "/points", "/mesh/triangles", "/pieces/vertices", "/pieces/bulges", "/pieces/stroke"};
    Sha256 sum;
    const auto put = [&](const auto* first, std::size_t count) {
        sum.update({reinterpret_cast<const unsigned char*>(first), count * sizeof(*first)});
    };
    const auto put_size = [&](std::uint64_t size) { put(&size, 1); };
    const auto put_text = [&](std::string_view text) {
        put_size(text.size());
        put(text.data(), text.size());
    };
    put_text("vfplan review 1");
    put(geometry.data(), geometry.size());
    for (const auto& [path, value] : content) {
        if (row_at(path).mark == Mark::none) continue;
        put_text(path);
        put_text(name_of(value.type));
        put_size(value.shape.size());
        for (const std::size_t side : value.shape) put_size(side);
        if (std::find(in_geometry.begin(), in_geometry.end(), path) != in_geometry.end()) continue;
        value.visit([&]<class T>(const std::vector<T>& all) {
            if constexpr (std::is_arithmetic_v<T>) {
                put(all.data(), all.size());
            } else {
                for (const std::string& text : all) put_text(text);
            }
        });
    }
    return to_hex(view(sum.digest()));
}

/// The review is that of this plan, and not of what it was before somebody changed it.
inline void check_reviewed(const Content& content, const Digest& geometry, Findings& findings) {
    if (!content.has_group("/review")) return;
    const std::string& found = content.at("/review@digest").string();
    const std::string wanted = review_digest(content, geometry);
    findings.require(found == wanted, "unsafe.review", "/review@digest",
                     {"is that of another plan: it is ", Quoted{found}, ", and this plan has ",
                      Quoted{wanted}, ". Somebody changed the plan after the review"});
}

inline void check_case(const Content& content, Findings& findings) {
    if (!content.has("/@case")) return;
    const std::string& text = content.at("/@case").string();
    findings.require(is_plain(text), "corrupt.value", "/@case",
                     {"is ", Quoted{text}, "; text wanted that can be read off a page"},
                     "Write it without hidden characters, and without a blank at its ends");
}

inline void check_pairs(const Content& content, Findings& findings) {
    for (const auto& [one, other] :
         {std::pair{"/provenance/input_roles", "/provenance/input_sha256"},
          std::pair{"/provenance/setting_names", "/provenance/setting_values"}}) {
        const Value* names = content.find(one);
        findings.require((names != nullptr) == content.has(other), "corrupt.missing", "/provenance",
                         {"has one of ", one, " and ", other, ", which need each other"},
                         "Write both or neither");
        if (names == nullptr) continue;
        check_unique(names->text, one, findings);
        findings.require(
            std::all_of(names->text.begin(), names->text.end(), is_name), "corrupt.value", one,
            {"holds a name with other characters than letters, digits, '_', '.' and '-'"},
            "Write names of these");
    }
}

inline void check_provenance(const Content& content, Findings& findings) {
    check_pairs(content, findings);
    const auto each = [&](std::string_view path, bool (*good)(std::string_view)) {
        const Value* list = content.find(path);
        if (list == nullptr) return;
        for (const std::string& text : list->text) {
            findings.require(good(text), "corrupt.value", path, {"holds ", Quoted{text}});
        }
    };
    each("/provenance/input_sha256", is_sha256);
    each("/provenance/setting_values", is_setting);
    const std::string& time = content.at("/provenance@created_utc").string();
    findings.require(is_utc_time(time), "corrupt.value", "/provenance@created_utc",
                     {"is ", Quoted{time}, "; YYYY-MM-DDThh:mm:ssZ wanted"});
}

}  // namespace detail

/// How many doubts of a checked content nobody has answered.
inline std::size_t count_unanswered(const Content& content) {
    if (!content.has("/findings/severity")) return 0;
    const std::vector<std::string>& severity = content.at("/findings/severity").text;
    const Value* by = content.find("/findings/answered_by");
    std::size_t count = 0;
    for (std::size_t i = 0; i < severity.size(); ++i) {
        const bool answered = by != nullptr && !by->text[i].empty();
        if (severity[i] == "doubt" && !answered) ++count;
    }
    return count;
}

namespace detail {

/// A rule needs a value that is not there. It has nothing to say where that was reported already,
/// or of a group that is not there; else the bundle is refused.
inline void check_absent(const Content& content, std::string_view path, Findings& findings) {
    const std::string_view group = path.substr(0, path.find_first_of("/@", 1));
    const bool is_of_no_group = is_known(group) && group != path && !content.has_group(group);
    if (is_known(path) && (is_of_no_group || !findings.sound())) return;
    findings.error("corrupt.missing", path, {"is asked for by a rule, and is not there"},
                   "Get a program of another version: pip install --upgrade vfplan");
}

}  // namespace detail

/// A rule: reports to findings what does not hold; throws Absent if a value it needs is missing.
using CheckOf = void (*)(const Content&, Findings&);

/// Applies every rule.
inline void check(const Content& content, Findings& findings) {
    const auto apply = [&](const auto& rule) {
        try {
            rule(content, findings);
        } catch (const Absent& absent) {
            detail::check_absent(content, absent.what(), findings);
        }
    };
    for (const CheckOf rule :
         {detail::check_understood, detail::check_groups, detail::check_frames}) {
        apply(rule);
    }
    Digest geometry{};
    apply([&](const Content&, Findings&) {
        geometry = detail::geometry_digest(content);
        detail::check_identity(content, geometry, findings);
    });
    for (const CheckOf rule :
         {detail::check_case, detail::check_curve, detail::check_pieces, detail::check_mesh,
          detail::check_rendering, detail::check_guidance, detail::check_registration,
          detail::check_findings, detail::check_review, detail::check_provenance}) {
        apply(rule);
    }
    if (findings.sound()) apply(detail::check_leak);
    const bool certified = findings.sound();
    if (certified) {
        for (const CheckOf rule : {detail::check_one_curve, detail::check_corners,
                                   detail::check_stability, detail::check_registered}) {
            apply(rule);
        }
        apply([&](const Content&, Findings&) {
            detail::check_reviewed(content, geometry, findings);
        });
    } else {
        findings.note("leak.unchecked", "/leak", {"is not checked, because of the errors above"},
                      "Mend those first");
    }
}

}  // namespace vfplan::bundle
