// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Made by docs/make_format.py from schemas/bundle-2.0.json: do not edit.
// clang-format off
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "vfplan/base/vec.hpp"
#include "vfplan/bundle/bytes.hpp"

namespace vfplan::bundle {

enum class Kind { group, dataset, attribute };
enum class Type { none, text, f8, i4, u1 };
enum class Required { always, group, rendering, optional };
/// What an engine renders, or what is reviewed beside it: a review's digest covers both.
enum class Mark { none, rendered, reviewed };

/// One thing a bundle may hold; an empty text means that there is none.
struct Row {
    std::string_view path;
    Kind kind;
    Type type;
    Required required;
    std::array<std::string_view, 2> shape;  // a number, or the letter of a size
    std::string_view unit;                  // "@frame", "@source_frame": px in image, else m
    std::string_view frame;
    std::string_view allowed;  // separated by |
    double min, max, above, max_abs_m, max_abs_px;
    Version since;  // of the format that has it
    Mark mark;
};

/// The schema's name of a type.
constexpr std::string_view name_of(Type type) {
    constexpr std::array<std::string_view, 5> names{"none", "text", "f8", "i4", "u1"};
    return names[static_cast<std::size_t>(type)];
}

/// The most that a shape's letter may stand for.
struct Size {
    char letter;
    std::uint64_t max;
};

inline constexpr std::string_view format_name = "vfplan-fixture";
inline constexpr std::string_view format_version = "2.0";
inline constexpr Version newest{2, 0};

namespace limits {
inline constexpr std::uint64_t payload_bytes = 268435456;
inline constexpr std::uint64_t text_bytes = 4096;
inline constexpr std::uint64_t attributes_per_object = 16;
inline constexpr std::uint64_t links_per_group = 32;
}  // namespace limits

inline constexpr std::array<Size, 13> sizes{
    Size{'N', 4000000},
    Size{'S', 100000},
    Size{'M', 10000},
    Size{'D', 3},
    Size{'Q', 4},
    Size{'U', 12},
    Size{'K', 4000000},
    Size{'I', 64},
    Size{'C', 256},
    Size{'H', 64},
    Size{'E', 200000},
    Size{'V', 1000000},
    Size{'F', 1000},
};

inline constexpr std::array<Row, 90> rows{
    Row{"/", Kind::group, Type::none, Required::always, {"", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/@format", Kind::attribute, Type::text, Required::always, {"", ""}, "", "", "vfplan-fixture", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/@version", Kind::attribute, Type::text, Required::always, {"", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/@frame", Kind::attribute, Type::text, Required::always, {"", ""}, "", "", "image|robot_base|patient_lps", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::rendered},
    Row{"/@id", Kind::attribute, Type::text, Required::always, {"", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/@case", Kind::attribute, Type::text, Required::optional, {"", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::reviewed},
    Row{"/@must_understand", Kind::attribute, Type::text, Required::optional, {"", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/points", Kind::dataset, Type::f8, Required::always, {"N", "3"}, "@frame", "@frame", "", -infinity, infinity, -infinity, 100.0, 1000000.0, {2, 0}, Mark::rendered},
    Row{"/sigma", Kind::dataset, Type::f8, Required::optional, {"N", ""}, "@frame", "", "", 0.0, infinity, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/curve", Kind::group, Type::none, Required::optional, {"", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/curve/stroke", Kind::dataset, Type::i4, Required::group, {"N", ""}, "1", "", "", 0.0, infinity, -infinity, infinity, infinity, {2, 0}, Mark::rendered},
    Row{"/curve/closed", Kind::dataset, Type::u1, Required::group, {"S", ""}, "1", "", "", -infinity, 1.0, -infinity, infinity, infinity, {2, 0}, Mark::rendered},
    Row{"/curve/bridged", Kind::dataset, Type::u1, Required::optional, {"N", ""}, "1", "", "", -infinity, 1.0, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/curve/edited", Kind::dataset, Type::u1, Required::optional, {"N", ""}, "1", "", "", -infinity, 1.0, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/pieces", Kind::group, Type::none, Required::optional, {"", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/pieces/vertices", Kind::dataset, Type::f8, Required::group, {"V", "3"}, "@frame", "@frame", "", -infinity, infinity, -infinity, 100.0, 1000000.0, {2, 0}, Mark::rendered},
    Row{"/pieces/bulges", Kind::dataset, Type::f8, Required::group, {"V", ""}, "1", "", "", -1.0, 1.0, -infinity, infinity, infinity, {2, 0}, Mark::rendered},
    Row{"/pieces/stroke", Kind::dataset, Type::i4, Required::group, {"V", ""}, "1", "", "", 0.0, infinity, -infinity, infinity, infinity, {2, 0}, Mark::rendered},
    Row{"/pieces@error_m", Kind::attribute, Type::f8, Required::group, {"", ""}, "m", "", "", 0.0, 0.0001, -infinity, infinity, infinity, {2, 0}, Mark::reviewed},
    Row{"/mesh", Kind::group, Type::none, Required::optional, {"", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/mesh/triangles", Kind::dataset, Type::i4, Required::group, {"K", "3"}, "1", "", "", 0.0, infinity, -infinity, infinity, infinity, {2, 0}, Mark::rendered},
    Row{"/mesh@sample_radius_m", Kind::attribute, Type::f8, Required::optional, {"", ""}, "m", "", "", -infinity, 1.0, 0.0, infinity, infinity, {2, 0}, Mark::rendered},
    Row{"/image", Kind::group, Type::none, Required::optional, {"", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/image@width_px", Kind::attribute, Type::i4, Required::group, {"", ""}, "px", "", "", 1.0, 1000000.0, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/image@height_px", Kind::attribute, Type::i4, Required::group, {"", ""}, "px", "", "", 1.0, 1000000.0, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/image/pixel_spacing", Kind::dataset, Type::f8, Required::optional, {"2", ""}, "mm/px", "image", "", -infinity, 1000.0, 0.0, infinity, infinity, {2, 0}, Mark::none},
    Row{"/rendering", Kind::group, Type::none, Required::optional, {"", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/rendering/stiffness", Kind::dataset, Type::f8, Required::group, {"3", ""}, "N/m", "@frame", "", 0.0, 1000000.0, -infinity, infinity, infinity, {2, 0}, Mark::rendered},
    Row{"/rendering/ignore_axis", Kind::dataset, Type::f8, Required::optional, {"3", ""}, "1", "@frame", "", -1.0, 1.0, -infinity, infinity, infinity, {2, 0}, Mark::rendered},
    Row{"/rendering@contact_radius_m", Kind::attribute, Type::f8, Required::group, {"", ""}, "m", "", "", -infinity, 1.0, 0.0, infinity, infinity, {2, 0}, Mark::rendered},
    Row{"/rendering@band_m", Kind::attribute, Type::f8, Required::group, {"", ""}, "m", "", "", -infinity, 1.0, 0.0, infinity, infinity, {2, 0}, Mark::rendered},
    Row{"/rendering@point_radius_m", Kind::attribute, Type::f8, Required::group, {"", ""}, "m", "", "", 0.0, 1.0, -infinity, infinity, infinity, {2, 0}, Mark::rendered},
    Row{"/rendering@max_iterations", Kind::attribute, Type::i4, Required::optional, {"", ""}, "1", "", "", 1.0, 10000.0, -infinity, infinity, infinity, {2, 0}, Mark::rendered},
    Row{"/rendering@robot", Kind::attribute, Type::text, Required::optional, {"", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::reviewed},
    Row{"/rendering/stability", Kind::dataset, Type::f8, Required::optional, {"7", ""}, "kg, N s/m, Hz, 1, N/m, N/m, 1", "", "", 0.0, infinity, -infinity, infinity, infinity, {2, 0}, Mark::reviewed},
    Row{"/guidance", Kind::group, Type::none, Required::optional, {"", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/guidance@radius_m", Kind::attribute, Type::f8, Required::group, {"", ""}, "m", "", "", -infinity, 1.0, 0.0, infinity, infinity, {2, 0}, Mark::rendered},
    Row{"/guidance@stiffness_n_per_m", Kind::attribute, Type::f8, Required::group, {"", ""}, "N/m", "", "", -infinity, 1000000.0, 0.0, infinity, infinity, {2, 0}, Mark::rendered},
    Row{"/guidance@ends", Kind::attribute, Type::text, Required::group, {"", ""}, "", "", "stop|open", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::rendered},
    Row{"/guidance@lead_force_n", Kind::attribute, Type::f8, Required::optional, {"", ""}, "N", "", "", -1000.0, 1000.0, -infinity, infinity, infinity, {2, 0}, Mark::rendered},
    Row{"/guidance@lead_speed_m_s", Kind::attribute, Type::f8, Required::optional, {"", ""}, "m/s", "", "", -infinity, 10.0, 0.0, infinity, infinity, {2, 0}, Mark::rendered},
    Row{"/guidance@stroke", Kind::attribute, Type::i4, Required::optional, {"", ""}, "1", "", "", 0.0, 99999.0, -infinity, infinity, infinity, {2, 0}, Mark::rendered},
    Row{"/registration", Kind::group, Type::none, Required::optional, {"", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/registration@model", Kind::attribute, Type::text, Required::group, {"", ""}, "", "", "affine|similarity|rigid", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::reviewed},
    Row{"/registration@source_frame", Kind::attribute, Type::text, Required::group, {"", ""}, "", "", "image|patient_lps", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::reviewed},
    Row{"/registration@fre_rms_m", Kind::attribute, Type::f8, Required::group, {"", ""}, "m", "", "", 0.0, infinity, -infinity, infinity, infinity, {2, 0}, Mark::reviewed},
    Row{"/registration@loo_rms_m", Kind::attribute, Type::f8, Required::optional, {"", ""}, "m", "", "", 0.0, infinity, -infinity, infinity, infinity, {2, 0}, Mark::reviewed},
    Row{"/registration@tre_rms_m", Kind::attribute, Type::f8, Required::optional, {"", ""}, "m", "", "", 0.0, infinity, -infinity, infinity, infinity, {2, 0}, Mark::reviewed},
    Row{"/registration/T_robot_image", Kind::dataset, Type::f8, Required::group, {"Q", "Q"}, "m/@source_frame", "robot_base", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::reviewed},
    Row{"/registration/labels", Kind::dataset, Type::text, Required::group, {"M", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::reviewed},
    Row{"/registration/source", Kind::dataset, Type::f8, Required::group, {"M", "D"}, "@source_frame", "@source_frame", "", -infinity, infinity, -infinity, 100.0, 1000000.0, {2, 0}, Mark::reviewed},
    Row{"/registration/target", Kind::dataset, Type::f8, Required::group, {"M", "3"}, "m", "robot_base", "", -infinity, infinity, -infinity, 100.0, infinity, {2, 0}, Mark::reviewed},
    Row{"/registration@tool", Kind::attribute, Type::text, Required::optional, {"", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::reviewed},
    Row{"/registration/tip", Kind::dataset, Type::f8, Required::optional, {"3", ""}, "m", "tool", "", -infinity, infinity, -infinity, 100.0, infinity, {2, 0}, Mark::reviewed},
    Row{"/registration/residuals", Kind::dataset, Type::f8, Required::group, {"M", ""}, "m", "", "", 0.0, infinity, -infinity, infinity, infinity, {2, 0}, Mark::reviewed},
    Row{"/registration/covariance", Kind::dataset, Type::f8, Required::optional, {"U", "U"}, "T_robot_image^2", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::reviewed},
    Row{"/registration/tre", Kind::dataset, Type::f8, Required::optional, {"N", ""}, "m", "", "", 0.0, infinity, -infinity, infinity, infinity, {2, 0}, Mark::reviewed},
    Row{"/leak", Kind::group, Type::none, Required::rendering, {"", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/leak@kind", Kind::attribute, Type::text, Required::group, {"", ""}, "", "", "curve|mesh|cloud", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/leak@certified", Kind::attribute, Type::u1, Required::group, {"", ""}, "1", "", "", -infinity, 1.0, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/leak@largest_m", Kind::attribute, Type::f8, Required::group, {"", ""}, "m", "", "", 0.0, infinity, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/leak@limit_m", Kind::attribute, Type::f8, Required::optional, {"", ""}, "m", "", "", -infinity, infinity, 0.0, infinity, infinity, {2, 0}, Mark::none},
    Row{"/leak/place", Kind::dataset, Type::f8, Required::group, {"3", ""}, "@frame", "@frame", "", -infinity, infinity, -infinity, 100.0, infinity, {2, 0}, Mark::none},
    Row{"/leak/open_ends", Kind::dataset, Type::f8, Required::optional, {"E", "3"}, "@frame", "@frame", "", -infinity, infinity, -infinity, 100.0, infinity, {2, 0}, Mark::none},
    Row{"/leak@between_m", Kind::attribute, Type::f8, Required::optional, {"", ""}, "m", "", "", 0.0, infinity, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/leak/between_place", Kind::dataset, Type::f8, Required::optional, {"3", ""}, "@frame", "@frame", "", -infinity, infinity, -infinity, 100.0, infinity, {2, 0}, Mark::none},
    Row{"/leak@open_edges", Kind::attribute, Type::i4, Required::optional, {"", ""}, "1", "", "", 1.0, infinity, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/findings", Kind::group, Type::none, Required::optional, {"", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/findings/code", Kind::dataset, Type::text, Required::group, {"F", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::reviewed},
    Row{"/findings/severity", Kind::dataset, Type::text, Required::group, {"F", ""}, "", "", "note|doubt", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::reviewed},
    Row{"/findings/text", Kind::dataset, Type::text, Required::group, {"F", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::reviewed},
    Row{"/findings/stage", Kind::dataset, Type::text, Required::group, {"F", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::reviewed},
    Row{"/findings/has_place_px", Kind::dataset, Type::u1, Required::optional, {"F", ""}, "1", "", "", -infinity, 1.0, -infinity, infinity, infinity, {2, 0}, Mark::reviewed},
    Row{"/findings/place_px", Kind::dataset, Type::f8, Required::optional, {"F", "2"}, "px", "image", "", -infinity, infinity, -infinity, infinity, 1000000.0, {2, 0}, Mark::reviewed},
    Row{"/findings/has_place_m", Kind::dataset, Type::u1, Required::optional, {"F", ""}, "1", "", "", -infinity, 1.0, -infinity, infinity, infinity, {2, 0}, Mark::reviewed},
    Row{"/findings/place_m", Kind::dataset, Type::f8, Required::optional, {"F", "3"}, "m", "@frame", "", -infinity, infinity, -infinity, 100.0, infinity, {2, 0}, Mark::reviewed},
    Row{"/findings/answered_by", Kind::dataset, Type::text, Required::optional, {"F", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::reviewed},
    Row{"/findings/answered_utc", Kind::dataset, Type::text, Required::optional, {"F", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::reviewed},
    Row{"/review", Kind::group, Type::none, Required::optional, {"", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/review@by", Kind::attribute, Type::text, Required::group, {"", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/review@utc", Kind::attribute, Type::text, Required::group, {"", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/review@digest", Kind::attribute, Type::text, Required::group, {"", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/provenance", Kind::group, Type::none, Required::always, {"", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/provenance@created_utc", Kind::attribute, Type::text, Required::always, {"", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/provenance@software", Kind::attribute, Type::text, Required::always, {"", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/provenance/input_roles", Kind::dataset, Type::text, Required::optional, {"I", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/provenance/input_sha256", Kind::dataset, Type::text, Required::optional, {"I", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/provenance/setting_names", Kind::dataset, Type::text, Required::optional, {"C", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/provenance/setting_values", Kind::dataset, Type::text, Required::optional, {"C", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::none},
    Row{"/provenance/history", Kind::dataset, Type::text, Required::optional, {"H", ""}, "", "", "", -infinity, infinity, -infinity, infinity, infinity, {2, 0}, Mark::none},
};

}  // namespace vfplan::bundle
