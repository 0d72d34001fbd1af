// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Datatypes, dataspaces and values of single fields, each compared with its row of the format's
// table before a value is read.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "vfplan/bundle/bytes.hpp"
#include "vfplan/bundle/content.hpp"
#include "vfplan/bundle/finding.hpp"
#include "vfplan/bundle/header.hpp"
#include "vfplan/bundle/schema.hpp"
#include "vfplan/bundle/text.hpp"

namespace vfplan::bundle::detail {

inline void require(bool good, const char* code, const Row& row, std::string_view message) {
    require(good, code, row.path, message);
}

/// The datatype messages of float64, int32 and uint8, little-endian, behind the byte that holds
/// the message's version and the datatype's class; no other encoding of a number is allowed.
inline std::string_view encoding_of(Type type) {
    using namespace std::string_view_literals;
    return type == Type::f8   ? "\x20\x3f\0\x08\0\0\0\0\0\x40\0\x34\x0b\0\x34\xff\x03\0\0"sv
           : type == Type::i4 ? "\x08\0\0\x04\0\0\0\0\0\x20\0"sv
                              : "\0\0\0\x01\0\0\0\0\0\x08\0"sv;
}

/// The size in bytes of one element, whose datatype must be the row's, byte for byte.
inline std::size_t element_size(View message, const Row& row) {
    constexpr std::uint64_t integer = 0, floating = 1, string = 3;
    require(message.size() >= 8, "corrupt.hdf5", row, "has a datatype that is cut short");
    const std::uint64_t kind = message[0] & 15u, version = message[0] >> 4u;
    require(kind == integer || kind == floating || kind == string, "unsafe.type", row,
            "has a datatype of class " + std::to_string(kind) +
                "; numbers and fixed-length strings are allowed");
    require(version >= 1 && version <= 3, "corrupt.hdf5", row,
            "has a datatype of version " + std::to_string(version));
    const auto size = number_at(message, 4, 4);
    if (row.type != Type::text) {
        const bool same_class = kind == (row.type == Type::f8 ? floating : integer);
        require(same_class && message.from(1).text() == encoding_of(row.type), "corrupt.type", row,
                "has another type than " + std::string(name_of(row.type)));
        return static_cast<std::size_t>(size);
    }
    require(kind == string, "unsafe.type", row, "is not a fixed-length string");
    const std::uint64_t padding = message[1] & 15u, encoding = message[1] >> 4u;
    require(message.size() == 8 && encoding <= 1 && message[2] == 0 && message[3] == 0 && size > 0,
            "corrupt.type", row, "is text of another encoding");
    require(padding <= 1, "corrupt.type", row, "is text padded with blanks; NUL is wanted");
    require(size <= limits::text_bytes, "unsafe.cap", row,
            "is text of " + std::to_string(size) + " bytes; at most " +
                std::to_string(limits::text_bytes) + " allowed");
    return static_cast<std::size_t>(size);
}

/// An array's sides, or none of a scalar.
inline std::vector<std::uint64_t> sides_of(View message, const Row& row) {
    constexpr std::uint64_t scalar = 0, simple = 1;
    Window body(message, std::string(row.path));
    body.wanted(1, 2, "version of a dataspace");
    const auto rank = body.number(1), flags = body.number(1), kind = body.number(1);
    const bool array = kind == simple && rank > 0;
    require(rank <= 3 && flags <= 1 && (array || (kind == scalar && rank == 0 && flags == 0)),
            "corrupt.shape", row,
            "has a dataspace of kind " + std::to_string(kind) + ", rank " + std::to_string(rank));
    std::vector<std::uint64_t> sides, most;
    for (std::uint64_t i = 0; i < rank; ++i) sides.push_back(body.number(8));
    for (std::uint64_t i = 0; i < rank * flags; ++i) most.push_back(body.number(8));
    body.done();
    require(flags == 0 || sides == most, "unsafe.layout", row,
            "can grow; only arrays of fixed size are allowed");
    return sides;
}

/// Text without its padding of NUL.
inline std::string text_of(View raw, const Row& row) {
    std::size_t size = raw.size();
    while (size > 0 && raw[size - 1] == 0) --size;
    const std::string_view text = raw.first(size).text();
    require(is_utf8(text), "corrupt.text", row, "is not UTF-8");
    require(!has_control(text), "corrupt.text", row, "holds control characters");
    return std::string(text);
}

/// A value of `count` elements whose numbers are still to be filled in.
inline Value room_for(const Row& row, std::size_t count) {
    Value value;
    value.type = row.type;
    value.visit([&](auto& all) { all.resize(count); });
    return value;
}

/// Fills a value from bytes of elements of `size` bytes.
inline void fill(Value& value, View raw, std::size_t size, const Row& row) {
    value.visit([&]<class T>(std::vector<T>& all) {
        if constexpr (std::is_arithmetic_v<T>) {
            std::memcpy(all.data(), raw.data(), raw.size());
        } else {
            for (std::size_t i = 0; i < all.size(); ++i) {
                all[i] = text_of(raw.part(i * size, size), row);
            }
        }
    });
}

/// Refuses a fill value other than zeros.
inline void check_fill(const Object& object, std::size_t element) {
    if (!object.fill) return;
    Window body(*object.fill, object.path);
    body.wanted(1, 3, "version of a fill value");
    const auto flags = body.number(1);
    const auto size = (flags & 0x20) != 0 ? body.number(4) : 0;
    const View value = body.take(size);
    body.require((flags & 0xC0) == 0 && (flags & 0x30) != 0x30 && (size == 0 || size == element) &&
                     value.all_zero(),
                 "has another fill value than zero");
    body.done();
}

/// The bytes of a table, which stand in one piece; known to be so many, whatever the file says.
inline View data_of(File& file, const Object& object, std::uint64_t bytes, const Row& row) {
    constexpr std::uint64_t contiguous = 1;
    Window layout(*object.layout, object.path);
    layout.require(layout.number(1) == 3 && layout.number(1) == contiguous,
                   "is not stored in one piece, as libver v108 does; no other layout is allowed",
                   "unsafe.layout");
    const auto address = layout.number(8), size = layout.number(8);
    layout.done();
    require(address != nowhere, "corrupt.storage", row, "has no data");
    require(size == bytes, "corrupt.storage", row,
            "has " + std::to_string(size) + " bytes of data; its shape and type need " +
                std::to_string(bytes));
    return file.claim(address, size, object.path);
}

/// Every element of a table of this shape, whose datatype is known to be the row's.
inline Value table_of(File& file, const Object& object, const std::vector<std::uint64_t>& sides,
                      std::size_t element, const Row& row) {
    check_fill(object, element);
    std::uint64_t count = 1;  // the caps on sides and texts keep these products small
    for (const auto side : sides) count *= side;
    const View data = data_of(file, object, count * element, row);
    Value value = room_for(row, static_cast<std::size_t>(count));
    fill(value, data, element, row);
    for (const auto side : sides) value.shape.push_back(static_cast<std::size_t>(side));
    return value;
}

/// A scalar attribute of a row's type.
inline Value scalar_of(const Attribute& attribute, const Row& row) {
    require(sides_of(attribute.space, row).empty(), "corrupt.shape", row, "is not a scalar");
    const std::size_t size = element_size(attribute.type, row);
    require(attribute.data.size() == size, "corrupt.hdf5", row,
            "has " + std::to_string(attribute.data.size()) + " bytes; " + std::to_string(size) +
                " wanted");
    Value value = room_for(row, 1);
    fill(value, attribute.data, size, row);
    return value;
}

inline bool is_allowed(std::string_view text, std::string_view allowed) {
    for (std::size_t start = 0; start <= allowed.size();) {
        const std::size_t end = std::min(allowed.find('|', start), allowed.size());
        if (allowed.substr(start, end - start) == text) return true;
        start = end + 1;
    }
    return false;
}

/// The lowest and the highest of a value's numbers; NaN and NaN if one of them is NaN.
template <class T>
std::pair<double, double> extent(const std::vector<T>& numbers) {
    T low = numbers.front(), high = low;
    bool ordered = true;
    for (const T x : numbers) {
        low = x < low ? x : low;
        high = x > high ? x : high;
        ordered = ordered && x == x;
    }
    if (!ordered) return {std::nan(""), std::nan("")};
    return {static_cast<double>(low), static_cast<double>(high)};
}

/// Refuses a value outside of its row's range; `unit` is "m", "px" or another.
inline void check_range(const Value& value, const Row& row, std::string_view unit) {
    if (row.type == Type::text) {
        if (row.allowed.empty()) return;
        for (const std::string& text : value.text) {
            if (is_allowed(text, row.allowed)) continue;
            std::string choice(row.allowed);
            for (std::size_t at; (at = choice.find('|')) != std::string::npos;) {
                choice.replace(at, 1, " or ");
            }
            require(false, "corrupt.value", row,
                    "is " + in_quotes(text) + "; " + choice + " allowed");
        }
        return;
    }
    const auto [low, high] = row.type == Type::f8   ? extent(value.f8)
                             : row.type == Type::i4 ? extent(value.i4)
                                                    : extent(value.u1);
    require(std::isfinite(low) && std::isfinite(high), "corrupt.value", row,
            "holds a number that is not finite");
    const double cap = unit == "m" ? row.max_abs_m : unit == "px" ? row.max_abs_px : infinity;
    const double least = std::max(-cap, row.min), most = std::min(cap, row.max);
    require(low >= least && high <= most, "corrupt.range", row,
            "runs from " + shown(low) + " to " + shown(high) + "; " + shown(least) + " to " +
                shown(most) + " allowed");
    require(low > row.above, "corrupt.range", row,
            "is " + shown(low) + "; more than " + shown(row.above) + " wanted");
}

}  // namespace vfplan::bundle::detail
