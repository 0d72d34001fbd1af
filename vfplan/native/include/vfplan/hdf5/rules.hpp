// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Rules that tie several values together, in the order of docs/format.md and of
// vfplan/bundle/check.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "vfplan/hdf5/content.hpp"
#include "vfplan/hdf5/error.hpp"
#include "vfplan/hdf5/leak.hpp"
#include "vfplan/hdf5/seal.hpp"
#include "vfplan/hdf5/text.hpp"

namespace vfplan::hdf5 {

namespace detail {

inline void check_understood(const Content& content) {
    const Value* list = content.find("/@must_understand");
    if (list == nullptr) return;
    const std::string& text = list->string();
    for (std::size_t start = 0; start <= text.size();) {
        const std::size_t end = std::min(text.find(' ', start), text.size());
        const std::string path = text.substr(start, end - start);
        const bool known =
            std::any_of(rows.begin(), rows.end(), [&](const Row& row) { return row.path == path; });
        if (!path.empty() && !known) {
            refuse("version.must_understand", path, "must be understood, and this reader does not");
        }
        start = end + 1;
    }
}

inline void check_groups(const Content& content) {
    const std::string& frame = content.at("/@frame").string();
    const auto forbid = [&](std::string_view group, std::string_view in) {
        if (frame == in && content.has_group(group)) {
            refuse("corrupt.group", group, "must not be in the frame " + frame);
        }
    };
    forbid("/image", "patient_lps");
    forbid("/rendering", "image");
    forbid("/registration", "image");
    forbid("/registration", "patient_lps");
    forbid("/mesh", "image");
    if (content.has_group("/mesh") && content.has_group("/curve")) {
        refuse("corrupt.group", "/mesh", "must not stand beside /curve");
    }
}

inline void check_frames(const Content& content) {
    const std::vector<double>& points = content.at("/points").f8;
    if (content.at("/@frame").string() != "image") return;
    for (std::size_t i = 2; i < points.size(); i += 3) {
        if (points[i] != 0) {
            refuse("corrupt.value", "/points", "third column must be 0 in the frame image");
        }
    }
}

inline void check_identity(const Content& content) {
    const std::string& frame = content.at("/@frame").string();
    const std::vector<double>& points = content.at("/points").f8;
    const std::unique_ptr<EVP_MD_CTX, void (*)(EVP_MD_CTX*)> ctx(EVP_MD_CTX_new(), EVP_MD_CTX_free);
    Digest digest{};
    EVP_DigestInit_ex(ctx.get(), EVP_sha256(), nullptr);
    EVP_DigestUpdate(ctx.get(), frame.c_str(), frame.size() + 1);
    EVP_DigestUpdate(ctx.get(), points.data(), points.size() * sizeof(double));
    EVP_DigestFinal_ex(ctx.get(), digest.data(), nullptr);
    if (content.at("/@id").string() != to_hex(digest).substr(0, 32)) {
        refuse("corrupt.id", "/@id", "is not the id of these points");
    }
}

inline void check_curve(const Content& content) {
    if (!content.has("/curve/stroke")) return;
    const std::vector<std::int32_t>& stroke = content.at("/curve/stroke").i4;
    bool counts = stroke.front() == 0;
    for (std::size_t i = 1; i < stroke.size(); ++i) {
        const std::int64_t step = std::int64_t{stroke[i]} - stroke[i - 1];
        counts = counts && (step == 0 || step == 1);
    }
    if (!counts) refuse("corrupt.value", "/curve/stroke", "must count 0, 1, ... along the points");
    if (static_cast<std::size_t>(stroke.back()) + 1 != content.at("/curve/closed").u1.size()) {
        refuse("corrupt.shape", "/curve/closed", "has another number of strokes than the points");
    }
}

inline void check_mesh(const Content& content) {
    if (!content.has("/mesh/triangles")) return;
    const std::vector<std::int32_t>& triangles = content.at("/mesh/triangles").i4;
    const std::int32_t highest = *std::max_element(triangles.begin(), triangles.end());
    if (static_cast<std::size_t>(highest) >= content.at("/points").shape[0]) {
        refuse("corrupt.value", "/mesh/triangles", "names a point that is not there");
    }
}

inline void check_rendering(const Content& content) {
    if (!content.has("/rendering/stiffness")) return;
    if (const Value* axis = content.find("/rendering/ignore_axis")) {
        const std::vector<double>& a = axis->f8;
        if (std::abs(std::sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]) - 1) > 1e-9) {
            refuse("corrupt.value", "/rendering/ignore_axis", "has another length than 1");
        }
    }
    const double radius = content.at("/rendering@contact_radius_m").number() +
                          content.at("/rendering@point_radius_m").number();
    if (content.at("/rendering@band_m").number() >= radius) {
        refuse("corrupt.value", "/rendering@band_m", "must be less than R");
    }
}

inline void check_unique(const Content& content, std::string_view path) {
    if (!content.has(path)) return;
    const std::vector<std::string>& names = content.at(path).text;
    const std::set<std::string> different(names.begin(), names.end());
    if (different.size() != names.size() || different.contains("")) {
        refuse("corrupt.value", path, "must be different from each other and not empty");
    }
}

inline void check_registration(const Content& content) {
    if (!content.has("/registration@source_frame")) return;
    const bool from_image = content.at("/registration@source_frame").string() == "image";
    const Value& transform = content.at("/registration/T_robot_image");
    if (transform.shape[0] != (from_image ? 3 : 4) ||
        content.at("/registration/source").shape[1] != (from_image ? 2 : 3)) {
        refuse("corrupt.shape", "/registration",
               "(3, 3) and (M, 2) from the frame image, else (4, 4) and (M, 3)");
    }
    if (!from_image) {
        const std::vector<double>& t = transform.f8;
        if (t[12] != 0 || t[13] != 0 || t[14] != 0 || t[15] != 1) {
            refuse("corrupt.value", "/registration/T_robot_image", "last row must be 0 0 0 1");
        }
    }
    if (const Value* covariance = content.find("/registration/covariance")) {
        const std::size_t side = covariance->shape[0];
        for (std::size_t i = 0; i < side; ++i) {
            if (covariance->f8[i * side + i] < 0) {
                refuse("corrupt.value", "/registration/covariance", "has a negative variance");
            }
        }
    }
    check_unique(content, "/registration/labels");
}

inline void check_provenance(const Content& content) {
    if (!is_utc_time(content.at("/provenance@created_utc").string())) {
        refuse("corrupt.value", "/provenance@created_utc", "YYYY-MM-DDThh:mm:ssZ wanted");
    }
    for (const auto& [one, other] :
         {std::pair{"/provenance/input_roles", "/provenance/input_sha256"},
          std::pair{"/provenance/setting_names", "/provenance/setting_values"}}) {
        if (content.has(one) != content.has(other)) {
            refuse("corrupt.missing", "/provenance", "names and values need each other");
        }
        check_unique(content, one);
        if (!content.has(one)) continue;
        for (const std::string& name : content.at(one).text) {
            if (!is_name(name)) refuse("corrupt.value", one, "may hold letters, digits, _ . -");
        }
    }
    const auto each = [&](std::string_view path, bool (*good)(std::string_view)) {
        const Value* list = content.find(path);
        if (list == nullptr) return;
        for (const std::string& text : list->text) {
            if (!good(text)) refuse("corrupt.value", path, "holds something else");
        }
    };
    each("/provenance/input_sha256", is_sha256);
    each("/provenance/setting_values", is_setting);
}

}  // namespace detail

/// Throws at the first rule that does not hold.
inline void check(const Content& content) {
    detail::check_understood(content);
    detail::check_groups(content);
    detail::check_frames(content);
    detail::check_identity(content);
    detail::check_curve(content);
    detail::check_mesh(content);
    detail::check_rendering(content);
    detail::check_registration(content);
    detail::check_provenance(content);
    detail::check_leak(content);
}

}  // namespace vfplan::hdf5
