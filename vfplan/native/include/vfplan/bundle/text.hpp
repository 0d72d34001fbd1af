// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Small checks on text, and numbers as text, whatever the program's locale is.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <compare>
#include <cstdint>
#include <locale>
#include <sstream>
#include <string>
#include <string_view>

namespace vfplan::bundle {

/// Valid UTF-8: no overlong form, no surrogate, nothing above U+10FFFF.
inline bool is_utf8(std::string_view text) {
    for (std::size_t i = 0; i < text.size();) {
        const auto lead = static_cast<unsigned char>(text[i++]);
        const auto ones = static_cast<std::size_t>(std::countl_one(lead));
        const std::size_t end = i + (ones > 0 ? ones - 1 : 0);
        if (ones == 1 || ones > 4 || end > text.size()) return false;
        std::uint32_t code = lead & (0xFFu >> ones);
        while (i < end) {
            const auto next = static_cast<unsigned char>(text[i++]);
            if ((next & 0xC0) != 0x80) return false;
            code = code << 6 | (next & 0x3F);
        }
        constexpr std::array<std::uint32_t, 5> least{0, 0, 0x80, 0x800, 0x10000};
        if (code < least[ones] || code > 0x10FFFF || (code >= 0xD800 && code <= 0xDFFF)) {
            return false;
        }
    }
    return true;
}

/// Whether valid UTF-8 holds one of the control characters U+0000-1F or U+7F-9F.
inline bool has_control(std::string_view text) {
    for (std::size_t i = 0; i < text.size(); ++i) {
        const auto c = static_cast<unsigned char>(text[i]);
        if (c < 0x20 || c == 0x7F) return true;
        if (c == 0xC2 && static_cast<unsigned char>(text[i + 1]) < 0xA0) return true;
    }
    return false;
}

inline bool is_digit(char c) { return c >= '0' && c <= '9'; }

/// "YYYY-MM-DDThh:mm:ssZ"
inline bool is_utc_time(std::string_view text) {
    constexpr std::string_view form = "0000-00-00T00:00:00Z";
    if (text.size() != form.size()) return false;
    for (std::size_t i = 0; i < form.size(); ++i) {
        if (form[i] == '0' ? !is_digit(text[i]) : text[i] != form[i]) return false;
    }
    return true;
}

/// 64 lower-case hex digits.
inline bool is_sha256(std::string_view text) {
    return text.size() == 64 &&
           text.find_first_not_of("0123456789abcdef") == std::string_view::npos;
}

/// One or more ASCII letters, digits, '_', '.' or '-'.
inline bool is_name(std::string_view text) {
    constexpr std::string_view allowed =
        "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_.-";
    return !text.empty() && text.find_first_not_of(allowed) == std::string_view::npos;
}

/// A JSON number that float64 can hold.
inline bool is_number(std::string_view text) {
    std::size_t i = 0;
    const auto digits = [&] {
        const std::size_t start = i;
        while (i < text.size() && is_digit(text[i])) ++i;
        return i - start;
    };
    const auto take = [&](std::string_view any) {
        const bool there = i < text.size() && any.find(text[i]) != std::string_view::npos;
        i += there ? 1 : 0;
        return there;
    };
    take("-");
    const bool zero = i < text.size() && text[i] == '0';
    const std::size_t whole = digits();
    if (whole == 0 || (zero && whole > 1)) return false;
    if (take(".") && digits() == 0) return false;
    if (take("eE")) {
        take("+-");
        if (digits() == 0) return false;
    }
    if (i != text.size()) return false;
    std::istringstream stream{std::string(text)};
    stream.imbue(std::locale::classic());  // whatever the program's locale is
    double value = 0;
    stream >> value;
    return !stream.fail() && std::isfinite(value);
}

/// A setting's value: true, false, a JSON number, or text between double quotes.
inline bool is_setting(std::string_view text) {
    return text == "true" || text == "false" ||
           (text.size() >= 2 && text.front() == '"' && text.back() == '"') || is_number(text);
}

/// MAJOR.MINOR, the version of a format.
struct Version {
    int major = 0, minor = 0;

    auto operator<=>(const Version&) const = default;
};

/// Reads a version, each part 0..99999 without leading zeros; false if it is none.
inline bool is_version(std::string_view text, Version& version) {
    const std::size_t dot = text.find('.');
    if (dot == std::string_view::npos) return false;
    const auto parse = [](std::string_view part, int& value) {
        const char* end = part.data() + part.size();
        return !part.empty() && part.size() <= 5 && (part[0] != '0' || part.size() == 1) &&
               std::all_of(part.data(), end, is_digit) &&
               std::from_chars(part.data(), end, value).ptr == end;
    };
    return parse(text.substr(0, dot), version.major) && parse(text.substr(dot + 1), version.minor);
}

/// A number in the shortest form that reads back as itself, or as `form` says.
template <class... Form>
std::string shown(double x, Form... form) {
    std::array<char, 32> out{};
    return {out.data(), std::to_chars(out.data(), out.data() + out.size(), x, form...).ptr};
}
/// A number with six digits.
inline std::string rounded(double x) { return shown(x, std::chars_format::general, 6); }

/// Text of a file between quotes, cut short, with nothing in it that a terminal would obey.
inline std::string in_quotes(std::string_view text) {
    constexpr std::string_view digits = "0123456789abcdef";
    std::string out = "'";
    for (const char c : text.substr(0, 64)) {
        const auto byte = static_cast<unsigned char>(c);
        if (byte >= 0x20 && byte < 0x7F) {
            out += c;
        } else {
            out += {'\\', 'x', digits[byte >> 4], digits[byte & 15]};
        }
    }
    return out + "'";
}

}  // namespace vfplan::bundle
