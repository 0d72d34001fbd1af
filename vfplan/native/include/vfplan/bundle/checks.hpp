// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// What ties the values of a bundle together: points and pieces that agree, and the rules of the
// format. The leak certificate stands in leak.hpp.
#pragma once

#include "vfplan/bundle/leak.hpp"
#include "vfplan/bundle/reader.hpp"
#include "vfplan/bundle/seal.hpp"

namespace vfplan::bundle {

namespace detail {

// Values that must agree, because one is certified and another is rendered (docs/format.md,
// section 3): the points and the lines and arcs are one curve, the verdict on K is about the K of
// the file, and the registration is that of its markers and its points.

/// What two values that were computed in two ways may differ by [m].
inline constexpr double same_place_m = 1e-6;

/// How far points and pieces may be apart, as a share of R and in metres: what is certified,
/// approved and rendered is one curve.
inline constexpr double max_error_of_radius = 0.01, max_error_m = 1e-4;

/// Where on a piece a point is nearest, as the way from the beginning of the piece, and how far
/// away the point is [m].
struct PieceFoot {
    double way, distance;
};
inline PieceFoot foot_on(const Piece& piece, const Vec3& x) {
    const Vec3 at = piece.nearest(x);
    return {piece.arc(at), norm(x - at)};
}

/// How far points and pieces may be apart, and the way from a point to the next be long [m].
struct Apart {
    double tolerance;    // of a point from the pieces
    double slack;        // of the pieces from the line between two points, where these do not turn
    double longest_way;  // from a point to the next along the pieces
};

/// Follows a stroke's points along its pieces, in the order in which both were drawn: how many of
/// the points, and one more where the pieces also end there.
///
/// Every point lies within the tolerance of the pieces. From each point to the next the pieces keep
/// to the line between the two, but for the slack and what the points' own turns allow. The walk
/// begins at `way` on the piece `number`; a closed stroke leads back to its first point.
inline std::size_t follow(const std::vector<Piece>& pieces, const std::vector<Vec3>& points,
                          bool closed, const Apart& apart, std::size_t number, double way) {
    const std::size_t count = points.size(), steps = count + (closed ? 1 : 0);
    // How far the pieces may begin before the first point, and end behind the last [m].
    const double end_slack = apart.slack + apart.tolerance;
    const auto point = [&](std::size_t i) { return points[i % count]; };
    // Tangent of the angle by which the points turn at one of them, which is taken as 60 degrees at
    // most. The ends of an open stroke do not turn.
    const auto turn_at = [&](std::size_t i) {
        if (!closed && (i == 0 || i + 1 == count)) return 0.0;
        const Vec3 in = point(i) - point(i + count - 1), out = point(i + 1) - point(i);
        const double along = dot(in, out), aside = norm(cross(in, out));
        const double most = std::sqrt(3.0);
        return aside < most * along ? aside / along : most;
    };
    double to_go = 0;  // along the pieces to their end [m]
    for (const Piece& piece : pieces) to_go += piece.length;
    std::size_t pieces_left = pieces.size();  // that may still be entered, each once
    for (std::size_t i = 0; i < steps; ++i) {
        const bool is_first = i == 0;
        const Vec3 from = point(i + count - 1), to = point(i);
        const double turn = is_first ? 0 : std::max(turn_at(i - 1), turn_at(i));
        const double leeway = end_slack + 0.5 * norm(to - from) * turn;
        const double longest_way = is_first ? end_slack : apart.longest_way;
        // The first point of an open stroke has no line to it: there the way is short.
        const auto is_near = [&](const Vec3& place) {
            return is_first ||
                   foot_on(vfplan::detail::straight(from, to), place).distance <= leeway;
        };
        double walked = -way;  // to the beginning of the piece that is looked at
        for (bool has_arrived = false; !has_arrived;) {
            const Piece& piece = pieces[number];
            const PieceFoot foot = foot_on(piece, to);
            const double ahead = walked + foot.way;
            has_arrived = foot.distance <= apart.tolerance && ahead >= -2 * apart.tolerance &&
                          ahead <= longest_way;
            walked += piece.length;
            const bool is_last = !closed && number + 1 == pieces.size();
            if (!has_arrived &&
                (is_last || walked > longest_way || pieces_left == 0 || !is_near(piece.to)))
                return i;
            // A part of an arc whose ends are near the line is near it in its middle as well.
            const double end = has_arrived ? foot.way : piece.length;
            if (piece.radius != 0 && !is_near(piece.ahead(0.5 * (way + end)))) return i;
            way = has_arrived ? foot.way : 0;
            if (has_arrived) {
                to_go -= ahead;
            } else {
                number = (number + 1) % pieces.size();
                --pieces_left;
            }
        }
    }
    return to_go <= end_slack ? count + 1 : count;
}

/// How many of a stroke's points are followed from the beginning of its pieces. Where a closed one
/// begins, its first point does not say: at several places where it crosses itself there. Two
/// strands that cross meet in four pieces at most; a file with more than eight is no drawn curve.
inline std::size_t follow(const std::vector<Piece>& pieces, const std::vector<Vec3>& points,
                          bool closed, const Apart& apart) {
    if (!closed) return follow(pieces, points, closed, apart, 0, 0);
    std::size_t followed = 0, places = 0;
    for (std::size_t k = 0; k < pieces.size() && places < 8 && followed <= points.size(); ++k) {
        const PieceFoot foot = foot_on(pieces[k], points.front());
        if (foot.distance > apart.tolerance) continue;
        ++places;
        followed = std::max(followed, follow(pieces, points, closed, apart, k, foot.way));
    }
    return followed;
}

/// The points, which are certified, and the lines and arcs, which are rendered, are one curve.
inline void check_one_curve(const Content& content, Findings& findings) {
    const double error = content.number("/pieces@error_m"), radius = radius_of(content);
    const Vec3 axis = point_at(content.at("/rendering/ignore_axis").f8.data(), 0);
    const auto place = [&](const std::vector<double>& table, std::size_t i) {
        return across(point_at(table.data(), i), axis);
    };
    const double max_error = std::min(max_error_of_radius * radius, max_error_m);
    if (error > max_error) {
        return findings.error(
            "unsafe.pieces", "/pieces@error_m",
            {"is ", error, " m; at most ", max_error, " m allowed where R is ", radius, " m"},
            "Fit the pieces more closely, or leave them out");
    }
    const double tolerance = error + same_place_m;
    const Apart apart{tolerance, max_error, 2 * (content.number("/leak@largest_m") + tolerance)};
    const std::vector<double>& points = content.at("/points").f8;
    const std::vector<StrokeRange> ranges = strokes_of(content);
    const std::vector<Stroke> strokes = pieces_of(content);
    for (std::size_t number = 0; number < strokes.size(); ++number) {
        const Stroke& stroke = strokes[number];
        const std::size_t first = ranges[number].first, count = stroke.bulges.size();
        std::vector<Vec3> places(ranges[number].count);
        for (std::size_t i = 0; i < places.size(); ++i) places[i] = place(points, first + i);
        std::vector<Piece> pieces;
        for (std::size_t i = 0; i + (stroke.closed ? 0 : 1) < count; ++i) {
            vfplan::detail::cut(place(stroke.vertices, i), place(stroke.vertices, (i + 1) % count),
                                stroke.bulges[i], axis, infinity, pieces, 0.0);
        }
        const Vec3 dot = place(stroke.vertices, 0);
        if (pieces.empty()) pieces.push_back(vfplan::detail::straight(dot, dot));
        const std::size_t followed = follow(pieces, places, stroke.closed, apart);
        if (followed <= places.size()) {
            return findings.error("unsafe.pieces", "/pieces",
                                  {"leave the points of stroke ", number, " at point ",
                                   first + std::min(followed, places.size() - 1),
                                   ": what is rendered is not what is certified"},
                                  "Change both together, or leave the pieces out");
        }
    }
}

/// The largest eigenvalue of P K P, where P takes away the part along the ignored axis: the most
/// that the force grows with the depth, in any direction [N/m].
inline double largest_stiffness(const Content& content) {
    const std::vector<double>& K = content.at("/rendering/stiffness").f8;
    const Value* axis = content.find("/rendering/ignore_axis");
    if (axis == nullptr) return std::max({K[0], K[1], K[2]});
    const Slice plane(point_at(axis->f8.data(), 0));
    // K between two directions of the plane: a symmetric matrix of 2 rows.
    const auto element = [&](int i, int j) {
        double sum = 0;
        for (std::size_t k = 0; k < 3; ++k) sum += plane.e[i][k] * K[k] * plane.e[j][k];
        return sum;
    };
    const double a = element(0, 0), b = element(1, 1);
    return (a + b) / 2 + std::hypot((a - b) / 2, element(0, 1));
}

/// The verdict of the stability gate is about the K of this file, and says that it is stable.
inline void check_stability(const Content& content, Findings& findings) {
    if (!content.has("/rendering/stability") || !content.has("/rendering/stiffness")) return;
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

/// The registration is that of its markers; what comes from a slice lies in the plane to which it
/// takes the slice.
inline void check_registered(const Content& content, Findings& findings) {
    const Value& transform = content.at("/registration/T_robot_image");
    const std::size_t side = transform.shape[0];
    const std::vector<double>& t = transform.f8;
    const std::vector<double>& source = content.at("/registration/source").f8;
    const std::vector<double>& target = content.at("/registration/target").f8;
    const std::vector<double>& residuals = content.at("/registration/residuals").f8;
    std::vector<Vec3> columns;
    for (std::size_t k = 0; k < side; ++k) columns.emplace_back(t[k], t[side + k], t[2 * side + k]);
    double worst = 0;
    for (std::size_t i = 0; i < residuals.size(); ++i) {
        Vec3 place = columns.back();
        for (std::size_t k = 0; k + 1 < side; ++k) place += source[(side - 1) * i + k] * columns[k];
        const double residual = norm(place - point_at(target.data(), i));
        worst = std::max(worst, std::abs(residual - residuals[i]));
    }
    findings.require(worst <= same_place_m, "unsafe.registration", "/registration/residuals",
                     {"differ by up to ", worst, " m from what transform and markers give"});
    if (side != 3) return;
    const Vec3 normal = cross(columns[0], columns[1]);
    if (normal == Vec3{}) {
        return findings.error("unsafe.registration", "/registration/T_robot_image",
                              {"takes the slice to a line: its first two columns are parallel"},
                              "Register it with markers that lie on no line");
    }
    const std::vector<double>& points = content.at("/points").f8;
    double farthest = 0;
    for (std::size_t i = 0; 3 * i < points.size(); ++i)
        farthest =
            std::max(farthest, std::abs(dot(normal, point_at(points.data(), i) - columns[2])));
    farthest /= norm(normal);
    findings.require(
        farthest <= same_place_m, "unsafe.registration", "/points",
        {"lie up to ", farthest, " m from the plane to which the registration takes the slice"});
}

// Rules that tie several values together, in the order of docs/format.md.

inline void check_understood(const Content& content, Findings& findings) {
    if (!content.has("/@must_understand")) return;
    for (const std::string_view path : split(content.at("/@must_understand").string(), ' '))
        findings.require(path.empty() || row_of(path) != nullptr, "version.must_understand", path,
                         {"must be understood, and this program does not"},
                         "Get a program that does: pip install --upgrade vfplan");
}

/// Whether a text has a form, what is wanted, and what to do about another one.
struct FormRule {
    bool (*is_good)(std::string_view);
    std::string_view wanted, todo;
};
/// In the order of Form.
inline constexpr std::array<FormRule, 6> form_rules{{
    {[](std::string_view) { return true; }, "", ""},
    {is_name, "letters, digits, '_', '.' and '-'", "Write a name of these"},
    {is_plain, "text that can be read off a page", "Write it without hidden characters"},
    {is_utc_time, "YYYY-MM-DDThh:mm:ssZ", ""},
    {is_sha256, "64 hexadecimal digits", ""},
    {is_setting, "true, false, a number or text between double quotes", ""},
}};

inline void check_form(std::string_view text, Form form, std::string_view path,
                       Findings& findings) {
    const auto& [is_good, wanted, todo] = form_rules[static_cast<std::size_t>(form)];
    findings.require(is_good(text), "corrupt.value", path,
                     {"is ", Quoted{text}, "; ", wanted, " wanted"}, todo);
}

/// What the format's table says of its rows beyond what the reader has compared with them.
inline void check_rows(const Content& content, Findings& findings) {
    const std::string& frame = content.at("/@frame").string();
    for (const Row& row : rows) {
        const Value* value = content.find(row.path);
        findings.require(row.frames.empty() || holds(split(row.frames, '|'), frame) ||
                             (value == nullptr && !content.has_group(row.path)),
                         "corrupt.group", row.path, {"must not be in the frame ", Quoted{frame}},
                         "Leave it out");
        findings.require(row.needs.empty() || content.has(row.needs) == (value != nullptr),
                         "corrupt.missing", group_of(row.path),
                         {"has one of ", row.path, " and ", row.needs, ", which need each other"},
                         "Write both or neither");
        if (value == nullptr) continue;
        for (const std::string& text : value->text) check_form(text, row.form, row.path, findings);
        const std::set<std::string_view> different(value->text.begin(), value->text.end());
        findings.require(
            !row.unique || (different.size() == value->text.size() && !different.contains("")),
            "corrupt.value", row.path, {"has a text that is empty, or there twice"},
            "Give each a name of its own");
    }
    findings.require(!content.has_group("/mesh") || !content.has_group("/curve"), "corrupt.group",
                     "/mesh", {"must not stand beside /curve"}, "Leave one of them out");
}

inline void check_frames(const Content& content, Findings& findings) {
    if (content.at("/@frame").string() != "image") return;
    const std::vector<double>& points = content.at("/points").f8;
    for (std::size_t i = 2; i < points.size(); i += 3)
        if (points[i] != 0)
            return findings.error("corrupt.value", "/points",
                                  {"has a third column that is not 0, in the frame image"},
                                  "Write 0 there");
}

inline void add_count(Sha256& sum, std::uint64_t count) { sum.add(&count, sizeof count); }
inline void add_text(Sha256& sum, std::string_view text) {
    add_count(sum, text.size());
    sum.add(text.data(), text.size());
}
/// Adds numbers as they are stored, and texts each behind its length.
inline void add_elements(Sha256& sum, const Value& value) {
    value.visit([&]<class T>(const std::vector<T>& elements) {
        if constexpr (std::is_arithmetic_v<T>)
            sum.add(elements.data(), elements.size() * sizeof(T));
        else
            for (const std::string& text : elements) add_text(sum, text);
    });
}

/// Of what, behind the frame, the id is the beginning of a SHA-256.
inline constexpr std::array<std::string_view, 5> geometry{
    "/points", "/mesh/triangles", "/pieces/vertices", "/pieces/bulges", "/pieces/stroke"};

inline Digest geometry_digest(const Content& content) {
    const std::string& frame = content.at("/@frame").string();
    Sha256 sum;
    sum.add(frame.c_str(), frame.size() + 1);
    for (const std::string_view path : geometry)
        if (path == "/points" || content.has_group(group_of(path)))
            add_elements(sum, content.at(path));
    return sum.digest();
}

inline void check_identity(const Content& content, Findings& findings) {
    const std::string& found = content.at("/@id").string();
    const std::string wanted = to_hex(geometry_digest(content)).substr(0, 32);
    findings.require(found == wanted, "corrupt.id", "/@id",
                     {"is ", Quoted{found}, "; the geometry gives ", Quoted{wanted}});
}

/// The numbers of strokes, 0, ..., 0, 1, ..., 1, 2, ..., count up to the last stroke of /curve.
inline void check_strokes(const Content& content, std::string_view path, Findings& findings) {
    const std::vector<std::int32_t>& stroke = content.at(path).i4;
    const std::size_t strokes = content.at("/curve/closed").u1.size();
    const auto found = static_cast<std::size_t>(stroke.back()) + 1;
    const auto jump = std::adjacent_find(
        stroke.begin(), stroke.end(),
        [](std::int64_t one, std::int64_t next) { return next != one && next != one + 1; });
    const bool counts_up = stroke.front() == 0 && jump == stroke.end();
    if (counts_up && found != strokes && path == "/curve/stroke")
        return findings.error("corrupt.shape", "/curve/closed",
                              {"has ", strokes, " strokes; the points have ", found});
    findings.require(counts_up && found == strokes, "corrupt.value", path,
                     {"does not count 0, 1, ... to the ", strokes, " strokes of /curve"},
                     "Number the strokes in the order in which they were drawn");
}

inline void check_curve(const Content& content, Findings& findings) {
    check_strokes(content, "/curve/stroke", findings);
}

inline void check_pieces(const Content& content, Findings& findings) {
    if (!content.has_group("/pieces")) return;
    if (!content.has("/curve/closed") || !content.has("/rendering/ignore_axis")) {
        return findings.error("corrupt.group", "/pieces",
                              {"needs /curve and /rendering/ignore_axis"},
                              "Write these, or leave the group out");
    }
    check_strokes(content, "/pieces/stroke", findings);
}

/// Triangles name points that are there, and every point is a corner: who renders the points
/// renders nothing else.
inline void check_mesh(const Content& content, Findings& findings) {
    std::vector<bool> used(content.at("/points").shape[0], false);
    for (const std::int32_t row : content.at("/mesh/triangles").i4) {
        const auto point = static_cast<std::size_t>(row);
        if (point >= used.size()) {
            return findings.error(
                "corrupt.value", "/mesh/triangles",
                {"names point ", row, " of ", used.size(), ", which are numbered from 0"},
                "Name points that are there");
        }
        used[point] = true;
    }
    const auto free = std::find(used.begin(), used.end(), false);
    findings.require(free == used.end(), "unsafe.mesh", "/mesh/triangles",
                     {"leaves out point ", free - used.begin(),
                      ": what is certified is not all that is rendered"},
                     "Leave the point out, or give it a triangle");
}

inline void check_rendering(const Content& content, Findings& findings) {
    if (const Value* axis = content.find("/rendering/ignore_axis")) {
        const double length = norm(point_at(axis->f8.data(), 0));
        findings.require(std::abs(length - 1) <= 1e-9, "corrupt.value", "/rendering/ignore_axis",
                         {"has length ", length, "; 1 wanted"}, "Divide it by its length");
    }
    const double radius = radius_of(content), band = content.number("/rendering@band_m");
    findings.require(band < radius, "corrupt.value", "/rendering@band_m",
                     {"is ", band, " m; less than R = ", radius, " m wanted"},
                     "Write a narrower band");
}

inline void check_guidance(const Content& content, Findings& findings) {
    if (!content.has_group("/guidance")) return;
    for (const std::string_view group : {"/curve", "/rendering"}) {
        findings.require(content.has_group(group), "corrupt.group", "/guidance", {"needs ", group},
                         "Write that group, or leave this one out");
    }
    const Value* named = content.find("/@must_understand");
    findings.require(named != nullptr && holds(split(named->string(), ' '), "/guidance"),
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
        for (std::size_t i = 0; i < covariance->f8.size(); i += side + 1)
            if (covariance->f8[i] < 0)
                return findings.error("corrupt.value", "/registration/covariance",
                                      {"has a negative variance"},
                                      "Compute it anew: a variance is 0 or more");
    }
}

/// A finding without a place or an answer has zeros, or empty texts.
inline void check_findings(const Content& content, Findings& findings) {
    for (const auto& [flag, place] : {std::pair{"/findings/has_place_px", "/findings/place_px"},
                                      std::pair{"/findings/has_place_m", "/findings/place_m"}}) {
        const Value *there = content.find(flag), *places = content.find(place);
        if (there == nullptr || places == nullptr) continue;
        bool zeros = true;
        for (std::size_t i = 0; i < places->f8.size(); ++i)
            zeros = zeros && (there->u1[i / places->shape[1]] != 0 || places->f8[i] == 0);
        findings.require(zeros, "corrupt.value", place, {"holds a place of a finding without one"},
                         "Write zeros there");
    }
    const Value *by = content.find("/findings/answered_by"),
                *when = content.find("/findings/answered_utc");
    if (by == nullptr || when == nullptr) return;
    for (std::size_t i = 0; i < by->text.size(); ++i) {
        const std::string& time = when->text[i];
        if (!by->text[i].empty()) {
            check_form(by->text[i], Form::plain, "/findings/answered_by", findings);
            check_form(time, Form::utc, "/findings/answered_utc", findings);
        } else {
            findings.require(time.empty(), "corrupt.value", "/findings/answered_utc",
                             {"is ", Quoted{time}, "; nothing wanted where nobody answered"});
        }
    }
}

/// The digest of everything that is rendered or reviewed (docs/format.md, section 3).
inline std::string review_digest(const Content& content) {
    Sha256 sum;
    add_text(sum, "vfplan review 1");
    const Digest drawn = geometry_digest(content);
    sum.add(drawn.data(), drawn.size());
    for (const auto& [path, value] : content) {
        if (row_of(path)->mark == Mark::none) continue;
        add_text(sum, path);
        add_text(sum, type_names[static_cast<std::size_t>(value.type)]);
        add_count(sum, value.shape.size());
        for (const std::size_t side : value.shape) add_count(sum, side);
        if (std::ranges::find(geometry, path) == geometry.end()) add_elements(sum, value);
    }
    return to_hex(sum.digest());
}

/// The review is that of this plan, and not of what it was before somebody changed it.
inline void check_reviewed(const Content& content, Findings& findings) {
    const std::string& found = content.at("/review@digest").string();
    const std::string wanted = review_digest(content);
    findings.require(found == wanted, "unsafe.review", "/review@digest",
                     {"is that of another plan: it is ", Quoted{found}, ", and this plan has ",
                      Quoted{wanted}, ". Somebody changed the plan after the review"});
}

/// A rule needs a value that is not there. It has nothing to say where that was reported already,
/// or of a group that is not there; else the bundle is refused.
inline void check_absent(const Content& content, std::string_view path, Findings& findings) {
    const std::string_view group = group_of(path);
    const bool is_of_no_group = row_of(group) && group != path && !content.has_group(group);
    if (row_of(path) && (is_of_no_group || !findings.sound())) return;
    findings.error("corrupt.missing", path, {"is asked for by a rule, and is not there"},
                   "Get a program of another version: pip install --upgrade vfplan");
}

}  // namespace detail

/// A rule: reports to findings what does not hold; throws Absent if a value it needs is missing.
using CheckOf = void (*)(const Content&, Findings&);

/// Applies every rule.
inline void check(const Content& content, Findings& findings) {
    const auto apply = [&](std::initializer_list<CheckOf> rules) {
        for (const CheckOf rule : rules) {
            try {
                rule(content, findings);
            } catch (const Absent& absent) {
                detail::check_absent(content, absent.what(), findings);
            }
        }
    };
    apply({detail::check_understood, detail::check_rows, detail::check_frames,
           detail::check_identity, detail::check_curve, detail::check_pieces, detail::check_mesh,
           detail::check_rendering, detail::check_guidance, detail::check_registration,
           detail::check_findings});
    if (findings.sound()) apply({detail::check_leak});
    if (findings.sound()) {
        apply({detail::check_one_curve, detail::check_stability, detail::check_registered,
               detail::check_reviewed});
    } else {
        findings.add({"leak.unchecked", "/leak",
                      "is not checked, because of the errors above. Mend those first", false});
    }
}

}  // namespace vfplan::bundle
