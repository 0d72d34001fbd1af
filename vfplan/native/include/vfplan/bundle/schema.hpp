// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Made by docs/make_format.py from schemas/bundle-2.0.json: do not edit.
// clang-format off
#pragma once

#include "vfplan/base/vec.hpp"
#include "vfplan/bundle/bytes.hpp"

namespace vfplan::bundle {

enum class Kind { group, dataset, attribute };
enum class Type { none, text, f8, i4, u1 };
enum class Required { always, group, rendering, optional };
/// What an engine renders, or what is reviewed beside it: a review's digest covers both.
enum class Mark { none, rendered, reviewed };
/// What a text must be.
enum class Form { any, name, plain, utc, sha256, setting };

inline constexpr Version newest{2, 0};

/// One thing a bundle may hold; an empty text means that there is none.
struct Row {
    std::string_view path;
    Kind kind;
    Type type = Type::none;
    Required required = Required::optional;
    std::array<std::string_view, 2> shape{};  // a number, or the letter of a size
    std::string_view unit{};                  // "@frame", "@source_frame": px in image, else m
    std::string_view frame{};
    std::string_view allowed{};  // separated by |
    double min = -infinity, max = infinity, above = -infinity;
    double max_abs_m = infinity, max_abs_px = infinity;
    Mark mark = Mark::none;
    Form form = Form::any;
    std::string_view needs{};   // the path of a value that is there if this one is, and only then
    std::string_view frames{};  // of the points, in which it may be there; separated by |
    bool unique = false;         // its texts differ, and none is empty
};

/// The schema's names of types.
inline constexpr std::array<std::string_view, 5> type_names{"none", "text", "f8", "i4", "u1"};

/// The most that a shape's letter may stand for.
struct Size {
    char letter;
    std::uint64_t max;
};

inline constexpr std::string_view format_name = "vfplan-fixture";
inline constexpr std::string_view format_version = "2.0";

namespace limits {
inline constexpr std::uint64_t payload_bytes = 268435456;
inline constexpr std::uint64_t text_bytes = 4096;
inline constexpr std::uint64_t attributes_per_object = 16;
inline constexpr std::uint64_t links_per_group = 32;
}  // namespace limits

inline constexpr std::array<Size, 13> sizes{
    Size{'N', 4000000}, Size{'S', 100000}, Size{'M', 10000}, Size{'D', 3}, Size{'Q', 4},
    Size{'U', 12}, Size{'K', 4000000}, Size{'I', 64}, Size{'C', 256}, Size{'H', 64},
    Size{'E', 200000}, Size{'V', 1000000}, Size{'F', 1000}
};

inline constexpr std::array<Row, 90> rows{{
    {.path = "/", .kind = Kind::group, .required = Required::always},
    {.path = "/@format", .kind = Kind::attribute, .type = Type::text, .required = Required::always, .allowed = "vfplan-fixture"},
    {.path = "/@version", .kind = Kind::attribute, .type = Type::text, .required = Required::always},
    {.path = "/@frame", .kind = Kind::attribute, .type = Type::text, .required = Required::always, .allowed = "image|robot_base|patient_lps", .mark = Mark::rendered},
    {.path = "/@id", .kind = Kind::attribute, .type = Type::text, .required = Required::always},
    {.path = "/@case", .kind = Kind::attribute, .type = Type::text, .mark = Mark::reviewed, .form = Form::plain},
    {.path = "/@must_understand", .kind = Kind::attribute, .type = Type::text},
    {.path = "/points", .kind = Kind::dataset, .type = Type::f8, .required = Required::always, .shape = {"N", "3"}, .unit = "@frame", .frame = "@frame", .max_abs_m = 100.0, .max_abs_px = 1000000.0, .mark = Mark::rendered},
    {.path = "/sigma", .kind = Kind::dataset, .type = Type::f8, .shape = {"N"}, .unit = "@frame", .min = 0.0},
    {.path = "/curve", .kind = Kind::group},
    {.path = "/curve/stroke", .kind = Kind::dataset, .type = Type::i4, .required = Required::group, .shape = {"N"}, .unit = "1", .min = 0.0, .mark = Mark::rendered},
    {.path = "/curve/closed", .kind = Kind::dataset, .type = Type::u1, .required = Required::group, .shape = {"S"}, .unit = "1", .max = 1.0, .mark = Mark::rendered},
    {.path = "/curve/bridged", .kind = Kind::dataset, .type = Type::u1, .shape = {"N"}, .unit = "1", .max = 1.0},
    {.path = "/curve/edited", .kind = Kind::dataset, .type = Type::u1, .shape = {"N"}, .unit = "1", .max = 1.0},
    {.path = "/pieces", .kind = Kind::group},
    {.path = "/pieces/vertices", .kind = Kind::dataset, .type = Type::f8, .required = Required::group, .shape = {"V", "3"}, .unit = "@frame", .frame = "@frame", .max_abs_m = 100.0, .max_abs_px = 1000000.0, .mark = Mark::rendered},
    {.path = "/pieces/bulges", .kind = Kind::dataset, .type = Type::f8, .required = Required::group, .shape = {"V"}, .unit = "1", .min = -1.0, .max = 1.0, .mark = Mark::rendered},
    {.path = "/pieces/stroke", .kind = Kind::dataset, .type = Type::i4, .required = Required::group, .shape = {"V"}, .unit = "1", .min = 0.0, .mark = Mark::rendered},
    {.path = "/pieces@error_m", .kind = Kind::attribute, .type = Type::f8, .required = Required::group, .unit = "m", .min = 0.0, .max = 0.0001, .mark = Mark::reviewed},
    {.path = "/mesh", .kind = Kind::group, .frames = "robot_base|patient_lps"},
    {.path = "/mesh/triangles", .kind = Kind::dataset, .type = Type::i4, .required = Required::group, .shape = {"K", "3"}, .unit = "1", .min = 0.0, .mark = Mark::rendered},
    {.path = "/mesh@sample_radius_m", .kind = Kind::attribute, .type = Type::f8, .unit = "m", .max = 1.0, .above = 0.0, .mark = Mark::rendered},
    {.path = "/image", .kind = Kind::group, .frames = "image|robot_base"},
    {.path = "/image@width_px", .kind = Kind::attribute, .type = Type::i4, .required = Required::group, .unit = "px", .min = 1.0, .max = 1000000.0},
    {.path = "/image@height_px", .kind = Kind::attribute, .type = Type::i4, .required = Required::group, .unit = "px", .min = 1.0, .max = 1000000.0},
    {.path = "/image/pixel_spacing", .kind = Kind::dataset, .type = Type::f8, .shape = {"2"}, .unit = "mm/px", .frame = "image", .max = 1000.0, .above = 0.0},
    {.path = "/rendering", .kind = Kind::group, .frames = "robot_base|patient_lps"},
    {.path = "/rendering/stiffness", .kind = Kind::dataset, .type = Type::f8, .required = Required::group, .shape = {"3"}, .unit = "N/m", .frame = "@frame", .min = 0.0, .max = 1000000.0, .mark = Mark::rendered},
    {.path = "/rendering/ignore_axis", .kind = Kind::dataset, .type = Type::f8, .shape = {"3"}, .unit = "1", .frame = "@frame", .min = -1.0, .max = 1.0, .mark = Mark::rendered},
    {.path = "/rendering@contact_radius_m", .kind = Kind::attribute, .type = Type::f8, .required = Required::group, .unit = "m", .max = 1.0, .above = 0.0, .mark = Mark::rendered},
    {.path = "/rendering@band_m", .kind = Kind::attribute, .type = Type::f8, .required = Required::group, .unit = "m", .max = 1.0, .above = 0.0, .mark = Mark::rendered},
    {.path = "/rendering@point_radius_m", .kind = Kind::attribute, .type = Type::f8, .required = Required::group, .unit = "m", .min = 0.0, .max = 1.0, .mark = Mark::rendered},
    {.path = "/rendering@max_iterations", .kind = Kind::attribute, .type = Type::i4, .unit = "1", .min = 1.0, .max = 10000.0, .mark = Mark::rendered},
    {.path = "/rendering@robot", .kind = Kind::attribute, .type = Type::text, .mark = Mark::reviewed, .needs = "/rendering/stability"},
    {.path = "/rendering/stability", .kind = Kind::dataset, .type = Type::f8, .shape = {"7"}, .unit = "kg, N s/m, Hz, 1, N/m, N/m, 1", .min = 0.0, .mark = Mark::reviewed},
    {.path = "/guidance", .kind = Kind::group, .frames = "robot_base|patient_lps"},
    {.path = "/guidance@radius_m", .kind = Kind::attribute, .type = Type::f8, .required = Required::group, .unit = "m", .max = 1.0, .above = 0.0, .mark = Mark::rendered},
    {.path = "/guidance@stiffness_n_per_m", .kind = Kind::attribute, .type = Type::f8, .required = Required::group, .unit = "N/m", .max = 1000000.0, .above = 0.0, .mark = Mark::rendered},
    {.path = "/guidance@ends", .kind = Kind::attribute, .type = Type::text, .required = Required::group, .allowed = "stop|open", .mark = Mark::rendered},
    {.path = "/guidance@lead_force_n", .kind = Kind::attribute, .type = Type::f8, .unit = "N", .min = -1000.0, .max = 1000.0, .mark = Mark::rendered},
    {.path = "/guidance@lead_speed_m_s", .kind = Kind::attribute, .type = Type::f8, .unit = "m/s", .max = 10.0, .above = 0.0, .mark = Mark::rendered},
    {.path = "/guidance@stroke", .kind = Kind::attribute, .type = Type::i4, .unit = "1", .min = 0.0, .max = 99999.0, .mark = Mark::rendered},
    {.path = "/registration", .kind = Kind::group, .frames = "robot_base"},
    {.path = "/registration@model", .kind = Kind::attribute, .type = Type::text, .required = Required::group, .allowed = "affine|similarity|rigid", .mark = Mark::reviewed},
    {.path = "/registration@source_frame", .kind = Kind::attribute, .type = Type::text, .required = Required::group, .allowed = "image|patient_lps", .mark = Mark::reviewed},
    {.path = "/registration@fre_rms_m", .kind = Kind::attribute, .type = Type::f8, .required = Required::group, .unit = "m", .min = 0.0, .mark = Mark::reviewed},
    {.path = "/registration@loo_rms_m", .kind = Kind::attribute, .type = Type::f8, .unit = "m", .min = 0.0, .mark = Mark::reviewed},
    {.path = "/registration@tre_rms_m", .kind = Kind::attribute, .type = Type::f8, .unit = "m", .min = 0.0, .mark = Mark::reviewed},
    {.path = "/registration/T_robot_image", .kind = Kind::dataset, .type = Type::f8, .required = Required::group, .shape = {"Q", "Q"}, .unit = "m/@source_frame", .frame = "robot_base", .mark = Mark::reviewed},
    {.path = "/registration/labels", .kind = Kind::dataset, .type = Type::text, .required = Required::group, .shape = {"M"}, .mark = Mark::reviewed, .unique = true},
    {.path = "/registration/source", .kind = Kind::dataset, .type = Type::f8, .required = Required::group, .shape = {"M", "D"}, .unit = "@source_frame", .frame = "@source_frame", .max_abs_m = 100.0, .max_abs_px = 1000000.0, .mark = Mark::reviewed},
    {.path = "/registration/target", .kind = Kind::dataset, .type = Type::f8, .required = Required::group, .shape = {"M", "3"}, .unit = "m", .frame = "robot_base", .max_abs_m = 100.0, .mark = Mark::reviewed},
    {.path = "/registration@tool", .kind = Kind::attribute, .type = Type::text, .mark = Mark::reviewed},
    {.path = "/registration/tip", .kind = Kind::dataset, .type = Type::f8, .shape = {"3"}, .unit = "m", .frame = "tool", .max_abs_m = 100.0, .mark = Mark::reviewed},
    {.path = "/registration/residuals", .kind = Kind::dataset, .type = Type::f8, .required = Required::group, .shape = {"M"}, .unit = "m", .min = 0.0, .mark = Mark::reviewed},
    {.path = "/registration/covariance", .kind = Kind::dataset, .type = Type::f8, .shape = {"U", "U"}, .unit = "T_robot_image^2", .mark = Mark::reviewed},
    {.path = "/registration/tre", .kind = Kind::dataset, .type = Type::f8, .shape = {"N"}, .unit = "m", .min = 0.0, .mark = Mark::reviewed},
    {.path = "/leak", .kind = Kind::group, .required = Required::rendering},
    {.path = "/leak@kind", .kind = Kind::attribute, .type = Type::text, .required = Required::group, .allowed = "curve|mesh|cloud"},
    {.path = "/leak@certified", .kind = Kind::attribute, .type = Type::u1, .required = Required::group, .unit = "1", .max = 1.0},
    {.path = "/leak@largest_m", .kind = Kind::attribute, .type = Type::f8, .required = Required::group, .unit = "m", .min = 0.0},
    {.path = "/leak@limit_m", .kind = Kind::attribute, .type = Type::f8, .unit = "m", .above = 0.0},
    {.path = "/leak/place", .kind = Kind::dataset, .type = Type::f8, .required = Required::group, .shape = {"3"}, .unit = "@frame", .frame = "@frame", .max_abs_m = 100.0},
    {.path = "/leak/open_ends", .kind = Kind::dataset, .type = Type::f8, .shape = {"E", "3"}, .unit = "@frame", .frame = "@frame", .max_abs_m = 100.0},
    {.path = "/leak@between_m", .kind = Kind::attribute, .type = Type::f8, .unit = "m", .min = 0.0},
    {.path = "/leak/between_place", .kind = Kind::dataset, .type = Type::f8, .shape = {"3"}, .unit = "@frame", .frame = "@frame", .max_abs_m = 100.0},
    {.path = "/leak@open_edges", .kind = Kind::attribute, .type = Type::i4, .unit = "1", .min = 1.0},
    {.path = "/findings", .kind = Kind::group},
    {.path = "/findings/code", .kind = Kind::dataset, .type = Type::text, .required = Required::group, .shape = {"F"}, .mark = Mark::reviewed, .form = Form::name},
    {.path = "/findings/severity", .kind = Kind::dataset, .type = Type::text, .required = Required::group, .shape = {"F"}, .allowed = "note|doubt", .mark = Mark::reviewed},
    {.path = "/findings/text", .kind = Kind::dataset, .type = Type::text, .required = Required::group, .shape = {"F"}, .mark = Mark::reviewed},
    {.path = "/findings/stage", .kind = Kind::dataset, .type = Type::text, .required = Required::group, .shape = {"F"}, .mark = Mark::reviewed, .form = Form::name},
    {.path = "/findings/has_place_px", .kind = Kind::dataset, .type = Type::u1, .shape = {"F"}, .unit = "1", .max = 1.0, .mark = Mark::reviewed, .needs = "/findings/place_px"},
    {.path = "/findings/place_px", .kind = Kind::dataset, .type = Type::f8, .shape = {"F", "2"}, .unit = "px", .frame = "image", .max_abs_px = 1000000.0, .mark = Mark::reviewed},
    {.path = "/findings/has_place_m", .kind = Kind::dataset, .type = Type::u1, .shape = {"F"}, .unit = "1", .max = 1.0, .mark = Mark::reviewed, .needs = "/findings/place_m"},
    {.path = "/findings/place_m", .kind = Kind::dataset, .type = Type::f8, .shape = {"F", "3"}, .unit = "m", .frame = "@frame", .max_abs_m = 100.0, .mark = Mark::reviewed, .frames = "robot_base|patient_lps"},
    {.path = "/findings/answered_by", .kind = Kind::dataset, .type = Type::text, .shape = {"F"}, .mark = Mark::reviewed, .needs = "/findings/answered_utc"},
    {.path = "/findings/answered_utc", .kind = Kind::dataset, .type = Type::text, .shape = {"F"}, .mark = Mark::reviewed},
    {.path = "/review", .kind = Kind::group},
    {.path = "/review@by", .kind = Kind::attribute, .type = Type::text, .required = Required::group, .form = Form::plain},
    {.path = "/review@utc", .kind = Kind::attribute, .type = Type::text, .required = Required::group, .form = Form::utc},
    {.path = "/review@digest", .kind = Kind::attribute, .type = Type::text, .required = Required::group, .form = Form::sha256},
    {.path = "/provenance", .kind = Kind::group, .required = Required::always},
    {.path = "/provenance@created_utc", .kind = Kind::attribute, .type = Type::text, .required = Required::always, .form = Form::utc},
    {.path = "/provenance@software", .kind = Kind::attribute, .type = Type::text, .required = Required::always},
    {.path = "/provenance/input_roles", .kind = Kind::dataset, .type = Type::text, .shape = {"I"}, .form = Form::name, .needs = "/provenance/input_sha256", .unique = true},
    {.path = "/provenance/input_sha256", .kind = Kind::dataset, .type = Type::text, .shape = {"I"}, .form = Form::sha256},
    {.path = "/provenance/setting_names", .kind = Kind::dataset, .type = Type::text, .shape = {"C"}, .form = Form::name, .needs = "/provenance/setting_values", .unique = true},
    {.path = "/provenance/setting_values", .kind = Kind::dataset, .type = Type::text, .shape = {"C"}, .form = Form::setting},
    {.path = "/provenance/history", .kind = Kind::dataset, .type = Type::text, .shape = {"H"}},
}};

}  // namespace vfplan::bundle
