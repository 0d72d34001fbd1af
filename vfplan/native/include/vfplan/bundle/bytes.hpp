// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Bytes, text and numbers of a file that may be hostile, and what is wrong with one.
#pragma once

#include <bit>
#include <charconv>
#include <concepts>
#include <initializer_list>
#include <locale>
#include <span>
#include <sstream>
#include <stdexcept>

#include "vfplan/base/compiler.hpp"

#if defined(__BYTE_ORDER__) && __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "vfplan reads bundles on little-endian processors only: their numbers are copied as they are"
#endif

namespace vfplan::bundle {

// Small checks on text, and numbers as text, whatever the program's locale is.

/// The characters of valid UTF-8, without overlong forms, surrogates or anything above U+10FFFF;
/// nothing of other bytes.
inline std::optional<std::u32string> characters(std::string_view text) {
    std::u32string all;
    for (std::size_t i = 0; i < text.size();) {
        const auto lead = static_cast<unsigned char>(text[i++]);
        const auto ones = static_cast<std::size_t>(std::countl_one(lead));
        const std::size_t end = i + (ones > 0 ? ones - 1 : 0);
        if (ones == 1 || ones > 4 || end > text.size()) return std::nullopt;
        char32_t code = lead & (0xFFu >> ones);
        while (i < end) {
            const auto next = static_cast<unsigned char>(text[i++]);
            if ((next & 0xC0) != 0x80) return std::nullopt;
            code = code << 6 | (next & 0x3F);
        }
        constexpr std::array<char32_t, 5> lowest{0, 0, 0x80, 0x800, 0x10000};
        if (code < lowest[ones] || code > 0x10FFFF || (code >= 0xD800 && code <= 0xDFFF))
            return std::nullopt;
        all += code;
    }
    return all;
}
inline bool is_utf8(std::string_view text) { return characters(text).has_value(); }

/// The first and the last of characters that follow each other.
using Range = std::array<char32_t, 2>;

/// Whether valid UTF-8 holds a character of one of these ranges.
inline bool has_any(std::string_view text, std::span<const Range> ranges) {
    const std::u32string all = characters(text).value();
    for (const char32_t c : all)
        for (const auto& [first, last] : ranges)
            if (first <= c && c <= last) return true;
    return false;
}

/// Whether valid UTF-8 holds a control character.
inline bool has_control(std::string_view text) {
    return has_any(text, std::array<Range, 2>{{{0x00, 0x1F}, {0x7F, 0x9F}}});
}

/// Whether valid UTF-8 is not empty and can be read off a page as it is: no character is hidden or
/// turns the order of others, and the only blank is U+0020, inside.
inline bool is_plain(std::string_view text) {
    constexpr std::array<Range, 21> hidden{
        {{0x00, 0x1F},       {0x7F, 0xA0},     {0xAD, 0xAD},     {0x34F, 0x34F},   {0x61C, 0x61C},
         {0x115F, 0x1160},   {0x1680, 0x1680}, {0x17B4, 0x17B5}, {0x180B, 0x180F}, {0x2000, 0x200F},
         {0x2028, 0x202F},   {0x205F, 0x206F}, {0x3000, 0x3000}, {0x3164, 0x3164}, {0xE000, 0xF8FF},
         {0xFE00, 0xFE0F},   {0xFEFF, 0xFEFF}, {0xFFA0, 0xFFA0}, {0xFFF0, 0xFFFB}, {0xFFFE, 0xFFFF},
         {0xE0000, 0x10FFFF}}};
    return !text.empty() && text.front() != ' ' && text.back() != ' ' && !has_any(text, hidden);
}

/// The words of a text, with one separator between them.
inline std::vector<std::string_view> split(std::string_view text, char separator) {
    std::vector<std::string_view> words;
    for (std::size_t end; (end = text.find(separator)) != text.npos; text.remove_prefix(end + 1))
        words.push_back(text.substr(0, end));
    words.push_back(text);
    return words;
}
inline bool holds(const std::vector<std::string_view>& words, std::string_view word) {
    return std::find(words.begin(), words.end(), word) != words.end();
}

inline bool is_digit(char c) { return c >= '0' && c <= '9'; }

/// "YYYY-MM-DDThh:mm:ssZ"
inline bool is_utc_time(std::string_view text) {
    constexpr std::string_view form = "0000-00-00T00:00:00Z";
    if (text.size() != form.size()) return false;
    for (std::size_t i = 0; i < form.size(); ++i)
        if (form[i] == '0' ? !is_digit(text[i]) : text[i] != form[i]) return false;
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
    const auto digit_at = [&](std::size_t i) { return i < text.size() && is_digit(text[i]); };
    // What a stream reads and JSON does not: a plus in front, a base of 16, a zero before another
    // digit, a point without a digit on either side.
    const std::size_t first = text.starts_with('-') ? 1 : 0, point = text.find('.');
    if (text.find_first_not_of("0123456789.eE+-") != text.npos || !digit_at(first)) return false;
    if (text[first] == '0' && digit_at(first + 1)) return false;
    if (point != text.npos && !digit_at(point + 1)) return false;
    std::istringstream stream{std::string(text)};
    stream.imbue(std::locale::classic());  // whatever the program's locale is
    double value = 0;
    stream >> value;
    return !stream.fail() && stream.eof() && std::isfinite(value);
}

/// A setting's value: true, false, a JSON number, or text between double quotes.
inline bool is_setting(std::string_view text) {
    return text == "true" || text == "false" ||
           (text.size() >= 2 && text.front() == '"' && text.back() == '"') || is_number(text);
}

/// MAJOR.MINOR, the version of a format.
using Version = std::array<int, 2>;

/// Reads a version, each part 0..99999 without leading zeros; false if it is none.
inline bool is_version(const std::string& text, Version& version) {
    auto& [major, minor] = version;
    const char* end = text.data() + text.size();
    const char* dot = std::from_chars(text.data(), end, major).ptr;
    if (dot != end) std::from_chars(dot + 1, end, minor);
    return std::max(major, minor) <= 99999 && std::min(major, minor) >= 0 &&
           text == std::to_string(major) + "." + std::to_string(minor);
}

/// A number in the shortest form that reads back as itself, or as `form` says.
template <class... Form>
std::string shortest_text(double x, Form... form) {
    std::array<char, 32> out{};
    return {out.data(), std::to_chars(out.data(), out.data() + out.size(), x, form...).ptr};
}
/// A number with six digits.
inline std::string six_digits(double x) { return shortest_text(x, std::chars_format::general, 6); }

inline std::string hex_of(unsigned char byte) {
    constexpr std::string_view digits = "0123456789abcdef";
    return {digits[byte >> 4], digits[byte & 15]};
}

/// Text of a file between quotes, cut short, with nothing in it that a terminal would obey.
inline std::string quoted(std::string_view text) {
    std::string out = "'";
    for (const char c : text.substr(0, 64)) {
        const auto byte = static_cast<unsigned char>(c);
        out += byte >= 0x20 && byte < 0x7F ? std::string(1, c) : "\\x" + hex_of(byte);
    }
    return out + "'";
}

// What is wrong with a bundle: thrown at the first when loading, listed in full when validating.

/// One thing that is wrong with a bundle, or, as a note, was left unchecked.
struct Finding {
    std::string code, where, message;
    bool error = true;
};

/// A bundle that cannot be trusted, or a file that cannot be read.
///
/// `code` begins with "input" (no such file), "corrupt", "unsafe", "version" or "signature" and
/// is the code that `vfplan validate` prints; `where` is the path inside the bundle, or the file's
/// name, or empty; `what()` begins with it.
struct BundleError : std::runtime_error, Finding {
    explicit BundleError(Finding wrong)
        : std::runtime_error(wrong.where.empty() ? wrong.message
                                                 : wrong.where + ": " + wrong.message),
          Finding(std::move(wrong)) {}

    /// The name of the Python exception for the same finding, such as "CorruptError".
    [[nodiscard]] std::string kind() const {
        std::string name = code.substr(0, code.find('.')) + "Error";
        name[0] = static_cast<char>(name[0] - 'a' + 'A');
        return name;
    }
};

/// Text of a file, which a message shows between quotes.
struct Quoted {
    std::string_view text;
};

/// A part of a message: text, or a number.
struct Part {
    template <std::convertible_to<std::string_view> T>
    Part(const T& text) : text(std::string_view(text)) {}
    Part(Quoted quote) : text(quoted(quote.text)) {}
    Part(double number) : text(shortest_text(number)) {}
    template <std::integral T>
    Part(T count) : text(std::to_string(count)) {}

    std::string text;
};

/// A sentence in parts, such as {"has ", rank, " dimensions"}.
using Sentence = std::initializer_list<Part>;

namespace detail {

/// What to do about a finding, by its code, where the place that found it knows nothing better.
struct Advice {
    std::string_view code, text;
};
inline constexpr std::array<Advice, 20> advice{{
    {"corrupt.format", "Give a bundle that `vfplan plan` or `vfplan import` wrote"},
    {"corrupt.frame", "Write the attribute that the format has for it"},
    {"corrupt.hdf5", "Write the file anew with h5py and libver v108, or fetch it again"},
    {"corrupt.unit", "Write the attribute that the format has for it"},
    {"corrupt.seal", "Fetch the file again from where it was written"},
    {"input", "Check the name of the file"},
    {"signature.age", "Sign the bundle again"},
    {"signature.case", "Give the bundle that was signed for this case"},
    {"signature.key", "Ask who signed it, and trust that key if it is theirs"},
    {"signature.missing", "Sign it with `vfplan sign`"},
    {"signature.robot", "Give the bundle that was signed for this robot"},
    {"signature.wrong", "Do not use the file: fetch it again from who signed it"},
    {"unsafe.cap", "Write less: no reader takes more"},
    {"unsafe.filter", "Write the data without compression or another filter"},
    {"unsafe.layout", "Write it with h5py and libver v108, in one piece and of fixed size"},
    {"unsafe.link", "Write one hard link to each object"},
    {"unsafe.registration", "Change both together, or leave the older one out"},
    {"unsafe.review", "Have it reviewed as it is now: vfplan review"},
    {"unsafe.stability", "Change both together, or leave the older one out"},
    {"unsafe.unknown", "Leave it out, or read the file with a newer vfplan"},
}};

/// A finding that says what is wrong, and behind it what to do: `todo`, or the advice of the code
/// where there is none.
[[gnu::noinline, gnu::cold]] inline Finding finding(std::string_view code, std::string_view where,
                                                    Sentence wrong, std::string_view todo) {
    std::string message;
    for (const Part& part : wrong) message += part.text;
    if (todo.empty()) {
        const auto* found = std::ranges::find(advice, code, &Advice::code);
        todo = found == advice.end()
                   ? "Write what the format has there, or let vfplan write the bundle"
                   : found->text;
    }
    (message += ". ") += todo;
    return {std::string(code), std::string(where), std::move(message)};
}

/// Throws a BundleError: what is wrong, and what to do.
[[noreturn]] inline void refuse(std::string_view code, std::string_view where, Sentence wrong,
                                std::string_view todo = {}) {
    throw BundleError(finding(code, where, wrong, todo));
}

/// Throws a BundleError unless this is `good`.
inline void require(bool good, std::string_view code, std::string_view where, Sentence wrong,
                    std::string_view todo = {}) {
    if (!good) refuse(code, where, wrong, todo);
}

}  // namespace detail

/// Collects findings; a strict one throws the first error instead.
class Findings {
  public:
    explicit Findings(bool strict) : strict_(strict) {}

    void add(Finding found) {
        if (strict_ && found.error) throw BundleError(std::move(found));
        all_.push_back(std::move(found));
    }
    void require(bool good, std::string_view code, std::string_view where, Sentence wrong,
                 std::string_view todo = {}) {
        if (!good) add(detail::finding(code, where, wrong, todo));
    }
    void error(std::string_view code, std::string_view where, Sentence wrong,
               std::string_view todo = {}) {
        require(false, code, where, wrong, todo);
    }
    /// Does `work`, and collects the error with which that ends.
    template <class Work>
    void collect(const Work& work) {
        try {
            work();
        } catch (const BundleError& wrong) {
            add(wrong);
        }
    }
    [[nodiscard]] bool sound() const { return std::ranges::none_of(all_, &Finding::error); }
    [[nodiscard]] const std::vector<Finding>& all() const { return all_; }

  private:
    bool strict_;
    std::vector<Finding> all_;
};

// Bytes of a file that are read and never left: nothing here believes a length that a file states.

using Bytes = std::vector<unsigned char>;

/// Bytes that somebody else owns.
struct View : std::span<const unsigned char> {
    using std::span<const unsigned char>::span;
    View() = default;
    View(std::span<const unsigned char> bytes) : span(bytes) {}

    /// `count` bytes from `at` on; the caller knows that they are there.
    [[nodiscard]] View part(std::size_t at, std::size_t count) const { return subspan(at, count); }
    [[nodiscard]] View first(std::size_t count) const { return part(0, count); }
    [[nodiscard]] View from(std::size_t at) const { return part(at, size() - at); }

    [[nodiscard]] std::string_view text() const {
        return {reinterpret_cast<const char*>(data()), size()};
    }
    [[nodiscard]] bool begins(std::string_view start) const { return text().starts_with(start); }
    [[nodiscard]] bool all_zero() const {
        return std::all_of(begin(), end(), [](unsigned char byte) { return byte == 0; });
    }
};

/// The unsigned little-endian number of `width` <= 8 bytes at `at`.
inline std::uint64_t number_at(View data, std::size_t at, std::size_t width) {
    std::uint64_t value = 0;
    for (std::size_t i = width; i-- > 0;) value = value << 8 | data[at + i];
    return value;
}

namespace detail {

inline constexpr std::string_view hdf5_signature = "\x89HDF\r\n\x1a\n";

/// Reads bytes from front to back; what is wrong is reported at `where`, by BundleError.
class ByteReader {
  public:
    ByteReader(View data, std::string where) : data_(data), where_(std::move(where)) {}

    View take(std::uint64_t count) {
        require(count <= left(), {"has an object header that is cut short"});
        const View taken = data_.first(static_cast<std::size_t>(count));
        data_ = data_.from(taken.size());
        return taken;
    }
    std::uint64_t number(std::size_t width) { return number_at(take(width), 0, width); }
    void expect(std::size_t width, std::uint64_t value, const char* what) {
        const std::uint64_t found = number(width);
        require(found == value, {"has ", found, " as ", what, "; ", value, " wanted"});
    }
    void expect_end() const { require(left() == 0, {"has a header message that is too long"}); }

    [[nodiscard]] std::size_t left() const { return data_.size(); }

    void require(bool good, Sentence wrong, std::string_view code = "corrupt.hdf5",
                 std::string_view todo = {}) const {
        detail::require(good, code, where_, wrong, todo);
    }

  private:
    View data_;
    std::string where_;
};

}  // namespace detail

}  // namespace vfplan::bundle
