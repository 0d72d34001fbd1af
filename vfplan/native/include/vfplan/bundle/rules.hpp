// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Rules that tie several values together, in the order of docs/format.md. A rule whose values are
// missing says nothing: that they are missing has been reported.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "vfplan/bundle/agreement.hpp"
#include "vfplan/bundle/content.hpp"
#include "vfplan/bundle/digest.hpp"
#include "vfplan/bundle/finding.hpp"
#include "vfplan/bundle/leak.hpp"
#include "vfplan/bundle/schema.hpp"
#include "vfplan/bundle/text.hpp"

namespace vfplan::bundle {

namespace detail {

inline void check_understood(const Content& content, Findings& findings) {
    const std::string& text = content.at("/@must_understand").string();
    for (std::size_t start = 0; start <= text.size();) {
        const std::size_t end = std::min(text.find(' ', start), text.size());
        const std::string path = text.substr(start, end - start);
        const bool known =
            std::any_of(rows.begin(), rows.end(), [&](const Row& row) { return row.path == path; });
        findings.require(path.empty() || known, "version.must_understand", path,
                         "must be understood, and this program does not");
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
                         "corrupt.group", group, "must not be in the frame " + in_quotes(frame));
    };
    allow("/image", {"image", "robot_base"});
    allow("/rendering", {"robot_base", "patient_lps"});
    allow("/guidance", {"robot_base", "patient_lps"});
    allow("/registration", {"robot_base"});
    allow("/mesh", {"robot_base", "patient_lps"});
    findings.require(!content.has_group("/mesh") || !content.has_group("/curve"), "corrupt.group",
                     "/mesh", "must not stand beside /curve");
}

inline void check_frames(const Content& content, Findings& findings) {
    const std::vector<double>& points = content.at("/points").f8;
    if (content.at("/@frame").string() != "image") return;
    bool flat = true;
    for (std::size_t i = 2; i < points.size(); i += 3) flat = flat && points[i] == 0;
    findings.require(flat, "corrupt.value", "/points", "third column must be 0 in the frame image");
}

inline void check_identity(const Content& content, Findings& findings) {
    const std::string& frame = content.at("/@frame").string();
    const std::vector<double>& points = content.at("/points").f8;
    const std::string& found = content.at("/@id").string();
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
    const std::string wanted = to_hex(view(sum.digest())).substr(0, 32);
    findings.require(found == wanted, "corrupt.id", "/@id",
                     "is " + in_quotes(found) + "; the geometry gives " + in_quotes(wanted));
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
                              "must count 0, 1, ... along the points");
    }
    const std::size_t strokes = content.at("/curve/closed").u1.size();
    const auto found = static_cast<std::size_t>(stroke.back()) + 1;
    findings.require(
        found == strokes, "corrupt.shape", "/curve/closed",
        "has " + std::to_string(strokes) + " strokes; the points have " + std::to_string(found));
}

inline void check_pieces(const Content& content, Findings& findings) {
    if (!content.has_group("/pieces")) return;
    if (!content.has("/curve/closed") || !content.has("/rendering/ignore_axis")) {
        return findings.error("corrupt.group", "/pieces",
                              "needs /curve and /rendering/ignore_axis");
    }
    const std::vector<std::int32_t>& stroke = content.at("/pieces/stroke").i4;
    const std::size_t strokes = content.at("/curve/closed").u1.size();
    findings.require(counts_up(stroke) && static_cast<std::size_t>(stroke.back()) + 1 == strokes,
                     "corrupt.value", "/pieces/stroke",
                     "must count 0, 1, ... to the " + std::to_string(strokes) +
                         " strokes of /curve along the vertices");
}

inline void check_mesh(const Content& content, Findings& findings) {
    const std::vector<std::int32_t>& triangles = content.at("/mesh/triangles").i4;
    const std::int32_t highest = *std::max_element(triangles.begin(), triangles.end());
    const std::size_t count = content.at("/points").shape[0];
    findings.require(static_cast<std::size_t>(highest) < count, "corrupt.value", "/mesh/triangles",
                     "names point " + std::to_string(highest) + " of " + std::to_string(count));
}

inline void check_rendering(const Content& content, Findings& findings) {
    if (const Value* axis = content.find("/rendering/ignore_axis")) {
        const std::vector<double>& a = axis->f8;
        const double length = std::sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
        findings.require(std::abs(length - 1) <= 1e-9, "corrupt.value", "/rendering/ignore_axis",
                         "has length " + shown(length) + "; 1 wanted");
    }
    const double radius =
        content.number("/rendering@contact_radius_m") + content.number("/rendering@point_radius_m");
    findings.require(content.number("/rendering@band_m") < radius, "corrupt.value",
                     "/rendering@band_m", "must be less than R = " + shown(radius) + " m");
}

inline void check_guidance(const Content& content, Findings& findings) {
    if (!content.has_group("/guidance")) return;
    for (const std::string_view group : {"/curve", "/rendering"}) {
        findings.require(content.has_group(group), "corrupt.group", "/guidance",
                         "needs " + std::string(group));
    }
    const Value* named = content.find("/@must_understand");
    findings.require(
        named != nullptr && (" " + named->string() + " ").find(" /guidance ") != std::string::npos,
        "corrupt.missing", "/@must_understand", "does not name /guidance");
    const Value* stroke = content.find("/guidance@stroke");
    if (stroke == nullptr) return;
    const auto strokes = static_cast<std::int64_t>(content.at("/curve/closed").u1.size());
    findings.require(stroke->i4.front() < strokes && strokes >= 2, "corrupt.value",
                     "/guidance@stroke",
                     "is " + std::to_string(stroke->i4.front()) + "; " + std::to_string(strokes) +
                         " strokes leave no forbidden region beside such a one");
}

inline void check_unique(const std::vector<std::string>& names, std::string_view path,
                         Findings& findings) {
    const std::set<std::string_view> different(names.begin(), names.end());
    findings.require(different.size() == names.size() && !different.contains(""), "corrupt.value",
                     path, "must be different from each other and not empty");
}

inline void check_registration(const Content& content, Findings& findings) {
    const bool from_image = content.at("/registration@source_frame").string() == "image";
    const Value& transform = content.at("/registration/T_robot_image");
    const std::size_t columns = content.at("/registration/source").shape[1];
    const std::vector<double>& t = transform.f8;
    if (transform.shape[0] != (from_image ? 3 : 4) || columns != (from_image ? 2 : 3)) {
        findings.error("corrupt.shape", "/registration",
                       "T_robot_image has " + std::to_string(transform.shape[0]) +
                           " rows and source " + std::to_string(columns) +
                           " columns; 3 and 2 from the frame image, else 4 and 3");
    } else if (!from_image && (t[12] != 0 || t[13] != 0 || t[14] != 0 || t[15] != 1)) {
        findings.error("corrupt.value", "/registration/T_robot_image", "last row must be 0 0 0 1");
    }
    if (const Value* covariance = content.find("/registration/covariance")) {
        const std::size_t side = covariance->shape[0];
        bool negative = false;
        for (std::size_t i = 0; i < side; ++i) {
            negative = negative || covariance->f8[i * side + i] < 0;
        }
        findings.require(!negative, "corrupt.value", "/registration/covariance",
                         "has a negative variance");
    }
    check_unique(content.at("/registration/labels").text, "/registration/labels", findings);
}

/// Places and answers come in pairs; a finding without one has zeros, or empty texts.
inline void check_findings(const Content& content, Findings& findings) {
    if (!content.has_group("/findings")) return;
    for (const std::string_view path : {"/findings/code", "/findings/stage"}) {
        const std::vector<std::string>& names = content.at(path).text;
        findings.require(std::all_of(names.begin(), names.end(), is_name), "corrupt.value", path,
                         "may hold letters, digits, '_', '.', '-'");
    }
    for (const auto& [flag, place] : {std::pair{"/findings/has_place_px", "/findings/place_px"},
                                      std::pair{"/findings/has_place_m", "/findings/place_m"}}) {
        findings.require(content.has(flag) == content.has(place), "corrupt.missing", "/findings",
                         std::string(flag) + " and " + place + " need each other");
        if (!content.has(flag) || !content.has(place)) continue;
        const std::vector<std::uint8_t>& there = content.at(flag).u1;
        const std::vector<double>& places = content.at(place).f8;
        const std::size_t columns = places.size() / there.size();
        bool zeros = true;
        for (std::size_t i = 0; i < places.size(); ++i) {
            zeros = zeros && (there[i / columns] != 0 || places[i] == 0);
        }
        findings.require(zeros, "corrupt.value", place, "holds a place of a finding without one");
    }
    findings.require(!content.has("/findings/place_m") || content.at("/@frame").string() != "image",
                     "corrupt.group", "/findings/place_m", "must not be in the frame 'image'");
    const Value *by = content.find("/findings/answered_by"),
                *when = content.find("/findings/answered_utc");
    findings.require((by == nullptr) == (when == nullptr), "corrupt.missing", "/findings",
                     "/findings/answered_by and /findings/answered_utc need each other");
    if (by == nullptr || when == nullptr) return;
    for (std::size_t i = 0; i < by->text.size(); ++i) {
        const std::string& time = when->text[i];
        const bool answered = !by->text[i].empty();
        findings.require(answered ? is_utc_time(time) : time.empty(), "corrupt.value",
                         "/findings/answered_utc",
                         "is " + in_quotes(time) + "; " +
                             (answered ? "YYYY-MM-DDThh:mm:ssZ" : "nothing") + " wanted");
    }
}

inline void check_review(const Content& content, Findings& findings) {
    if (!content.has_group("/review")) return;
    const std::string &by = content.at("/review@by").string(),
                      &time = content.at("/review@utc").string(),
                      &digest = content.at("/review@digest").string();
    findings.require(!by.empty(), "corrupt.value", "/review@by", "is empty");
    findings.require(is_utc_time(time), "corrupt.value", "/review@utc",
                     "is " + in_quotes(time) + "; YYYY-MM-DDThh:mm:ssZ wanted");
    findings.require(is_sha256(digest), "corrupt.value", "/review@digest",
                     "is " + in_quotes(digest) + "; 64 hexadecimal digits wanted");
}

inline void check_pairs(const Content& content, Findings& findings) {
    for (const auto& [one, other] :
         {std::pair{"/provenance/input_roles", "/provenance/input_sha256"},
          std::pair{"/provenance/setting_names", "/provenance/setting_values"}}) {
        const Value* names = content.find(one);
        findings.require((names != nullptr) == content.has(other), "corrupt.missing", "/provenance",
                         std::string(one) + " and " + other + " need each other");
        if (names == nullptr) continue;
        check_unique(names->text, one, findings);
        findings.require(std::all_of(names->text.begin(), names->text.end(), is_name),
                         "corrupt.value", one, "may hold letters, digits, '_', '.', '-'");
    }
}

inline void check_provenance(const Content& content, Findings& findings) {
    check_pairs(content, findings);
    const auto each = [&](std::string_view path, bool (*good)(std::string_view)) {
        const Value* list = content.find(path);
        if (list == nullptr) return;
        for (const std::string& text : list->text) {
            findings.require(good(text), "corrupt.value", path, "holds " + in_quotes(text));
        }
    };
    each("/provenance/input_sha256", is_sha256);
    each("/provenance/setting_values", is_setting);
    const std::string& time = content.at("/provenance@created_utc").string();
    findings.require(is_utc_time(time), "corrupt.value", "/provenance@created_utc",
                     "is " + in_quotes(time) + "; YYYY-MM-DDThh:mm:ssZ wanted");
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

/// A rule: reports to findings what does not hold; throws Absent if a value it needs is missing.
using CheckOf = void (*)(const Content&, Findings&);

/// Applies every rule.
inline void check(const Content& content, Findings& findings) {
    const auto apply = [&](CheckOf rule) {
        try {
            rule(content, findings);
        } catch (const Absent&) {
        }
    };
    for (const CheckOf rule :
         {detail::check_understood, detail::check_groups, detail::check_frames,
          detail::check_identity, detail::check_curve, detail::check_pieces, detail::check_mesh,
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
    } else {
        findings.note("leak.unchecked", "/leak", "not checked, because of the errors above");
    }
}

}  // namespace vfplan::bundle
