// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Single fields of an HDF5 file: attributes, tables and their storage, each compared with its row
// of the format's table before a value is read.
#pragma once

#include <hdf5.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <map>
#include <numeric>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "vfplan/hdf5/content.hpp"
#include "vfplan/hdf5/error.hpp"
#include "vfplan/hdf5/handle.hpp"
#include "vfplan/hdf5/schema.hpp"
#include "vfplan/hdf5/text.hpp"

namespace vfplan::hdf5 {

/// The group a row's thing lies in, and its name there.
inline std::pair<std::string, std::string> split(const Row& row) {
    const std::string path(row.path);
    if (row.kind == Kind::attribute) {
        const auto at = path.find('@');
        return {path.substr(0, at), path.substr(at + 1)};
    }
    const auto slash = path.rfind('/');
    return {slash == 0 ? "/" : path.substr(0, slash), path.substr(slash + 1)};
}

/// A unit or frame of a row with "@frame" and "@source_frame" filled in.
inline std::string filled(std::string_view text, const Content& content, bool as_unit) {
    std::string out(text);
    const auto put = [&](std::string_view name, std::string_view path) {
        const auto at = out.find(name);
        if (at == std::string::npos) return;
        const Value* frame = content.find(path);
        const std::string known = frame != nullptr ? frame->string() : "?";
        const bool metres = known == "robot_base" || known == "patient_lps";
        out.replace(at, name.size(), as_unit ? (metres ? "m" : "px") : known);
    };
    put("@frame", "/@frame");
    put("@source_frame", "/registration@source_frame");
    return out;
}

namespace detail {

/// Refuse a payload whose first 48 bytes are not a plain superblock of HDF5 1.10.
inline void check_superblock(std::span<const unsigned char> data) {
    const auto corrupt = [](const std::string& why) { throw BundleError("corrupt.hdf5", "", why); };
    const auto number = [&](std::size_t offset) {
        std::uint64_t value = 0;
        for (std::size_t i = 8; i-- > 0;) value = value << 8 | data[offset + i];
        return value;
    };
    constexpr std::array<unsigned char, 8> signature{0x89, 'H', 'D', 'F', '\r', '\n', 0x1a, '\n'};
    if (data.size() < 8 || !std::equal(signature.begin(), signature.end(), data.begin())) {
        corrupt("no HDF5 file: the signature is missing");
    }
    if (data.size() < 48) corrupt("too short for an HDF5 file");
    if ((data[8] != 2 && data[8] != 3) || data[9] != 8 || data[10] != 8 || data[11] != 0) {
        corrupt("superblock of another version or other sizes");
    }
    if (number(20) != ~std::uint64_t{0}) corrupt("the superblock has an extension");
    // Relative to the payload, or to the bundle with its seal in front: libhdf5 takes either.
    constexpr std::array<std::uint64_t, 5> bases{0, 512, 1024, 2048, 4096};
    if (std::find(bases.begin(), bases.end(), number(12)) == bases.end()) {
        corrupt("the superblock has another base address");
    }
    if (number(28) - number(12) != data.size()) corrupt("the superblock claims another size");
}

inline hid_t file_type(Type type) {
    switch (type) {
        case Type::f8:
            return H5T_IEEE_F64LE;
        case Type::i4:
            return H5T_STD_I32LE;
        case Type::u1:
            return H5T_STD_U8LE;
        default:
            return H5I_INVALID_HID;
    }
}

[[noreturn]] inline void wrong(const char* code, const Row& row, const std::string& message) {
    throw BundleError(code, std::string(row.path), message);
}

inline void need(bool good, const Row& row) {
    if (!good) throw BundleError("corrupt.hdf5", std::string(row.path), "cannot be read");
}

inline bool linked(hid_t group, const std::string& name) {
    return H5Lexists(group, name.c_str(), H5P_DEFAULT) > 0;
}

inline Handle open_object(hid_t group, const std::string& name, const Row& row, H5I_type_t kind) {
    Handle object(H5Oopen(group, name.c_str(), H5P_DEFAULT));
    need(object.valid(), row);
    if (H5Iget_type(object.get()) != kind) {
        wrong("corrupt.kind", row, "is another kind of object");
    }
    if (link_count(object.get()) != 1) {
        wrong("unsafe.link", row, "has several links to it; one is allowed");
    }
    return object;
}

/// The type's size in bytes.
inline std::size_t checked_type(hid_t type, const Row& row) {
    if (H5Tcommitted(type) != 0) wrong("unsafe.type", row, "has a named datatype");
    const std::size_t size = H5Tget_size(type);
    if (row.type != Type::text) {
        if (H5Tequal(type, file_type(row.type)) <= 0) wrong("corrupt.type", row, "other type");
        return size;
    }
    if (H5Tget_class(type) != H5T_STRING || H5Tis_variable_str(type) != 0) {
        wrong("unsafe.type", row, "is not a fixed-length string");
    }
    if (size > limits::text_bytes) {
        wrong("unsafe.cap", row, "is text of " + std::to_string(size) + " bytes");
    }
    if (H5Tget_strpad(type) == H5T_STR_SPACEPAD) {
        wrong("corrupt.type", row, "is text padded with blanks; NUL is wanted");
    }
    return size;
}

inline std::string text(const char* raw, std::size_t size, const Row& row) {
    while (size > 0 && raw[size - 1] == '\0') --size;
    const std::string_view text(raw, size);
    if (!is_utf8(text)) wrong("corrupt.text", row, "is not UTF-8");
    if (has_control(text)) wrong("corrupt.text", row, "holds control characters");
    return std::string(text);
}

inline Value decoded(const char* raw, std::size_t count, std::size_t size, const Row& row) {
    Value value;
    value.type = row.type;
    const auto copy = [&](auto& into) {
        into.resize(count);
        std::memcpy(into.data(), raw, count * size);
    };
    switch (row.type) {
        case Type::f8:
            copy(value.f8);
            break;
        case Type::i4:
            copy(value.i4);
            break;
        case Type::u1:
            copy(value.u1);
            break;
        default:
            for (std::size_t i = 0; i < count; ++i) {
                value.text.push_back(text(raw + i * size, size, row));
            }
    }
    return value;
}

/// A scalar attribute of a table's row.
inline Value scalar_attribute(hid_t where, const Row& row, const std::string& name) {
    const Handle attribute(H5Aopen(where, name.c_str(), H5P_DEFAULT));
    need(attribute.valid(), row);
    const Handle space(H5Aget_space(attribute.get()));
    if (H5Sget_simple_extent_type(space.get()) != H5S_SCALAR) {
        wrong("corrupt.shape", row, "is not a scalar");
    }
    const Handle type(H5Aget_type(attribute.get()));
    const std::size_t size = checked_type(type.get(), row);
    std::vector<char> raw(size);
    need(H5Aread(attribute.get(), type.get(), raw.data()) >= 0, row);
    return decoded(raw.data(), 1, size, row);
}

inline void check_own(hid_t dataset, const Row& row, const std::string& name,
                      const std::string& wanted) {
    if (H5Aexists(dataset, name.c_str()) <= 0) {
        wrong("corrupt.missing", row, "has no attribute " + name);
    }
    Row plain = row;
    plain.type = Type::text;
    if (scalar_attribute(dataset, plain, name).string() != wanted) {
        wrong(name == "unit" ? "corrupt.unit" : "corrupt.frame", row, wanted + " is wanted");
    }
}

inline Value values(hid_t dataset, hid_t type, const std::vector<std::size_t>& shape,
                    std::size_t size, const Row& row) {
    const std::size_t count =
        std::accumulate(shape.begin(), shape.end(), std::size_t{1}, std::multiplies<>());
    Value value;
    value.type = row.type;
    const auto read = [&](auto& into) {
        into.resize(count);
        need(H5Dread(dataset, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, into.data()) >= 0, row);
    };
    switch (row.type) {
        case Type::f8:
            read(value.f8);
            return value;
        case Type::i4:
            read(value.i4);
            return value;
        case Type::u1:
            read(value.u1);
            return value;
        default:
            break;
    }
    std::vector<char> raw(count * size);
    need(H5Dread(dataset, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, raw.data()) >= 0, row);
    return decoded(raw.data(), count, size, row);
}

inline void check_chunks(hid_t dataset, std::uint64_t count, std::uint64_t stored, const Row& row) {
    if (H5Dget_storage_size(dataset) != count * stored) {
        wrong("corrupt.storage", row, "chunks are missing or of another size");
    }
    if (count > limits::chunks_per_dataset) {
        wrong("unsafe.cap", row, "has " + std::to_string(count) + " chunks");
    }
    const Handle space(H5Dget_space(dataset));
    for (hsize_t i = 0; i < count; ++i) {
        std::array<hsize_t, 2> offset{};
        unsigned int mask = 0;
        haddr_t address = 0;
        hsize_t size = 0;
        need(H5Dget_chunk_info(dataset, space.get(), i, offset.data(), &mask, &address, &size) >= 0,
             row);
        if (mask != 0 || size != stored) {
            wrong("unsafe.filter", row, "a chunk did not pass fletcher32");
        }
    }
}

inline bool is_allowed(std::string_view text, std::string_view allowed) {
    for (std::size_t start = 0; start <= allowed.size();) {
        const std::size_t end = std::min(allowed.find('|', start), allowed.size());
        if (allowed.substr(start, end - start) == text) return true;
        start = end + 1;
    }
    return false;
}

inline void check_range(const Value& value, const Row& row, const Content& content) {
    if (row.type == Type::text) {
        if (!row.allowed.empty() && !is_allowed(value.string(), row.allowed)) {
            wrong("corrupt.value", row, "is " + value.string());
        }
        return;
    }
    double low = infinity, high = -infinity;
    const auto scan = [&](const auto& numbers) {
        for (const auto number : numbers) {
            const auto x = static_cast<double>(number);
            if (!std::isfinite(x)) {
                wrong("corrupt.value", row, "holds a number that is not finite");
            }
            low = std::min(low, x);
            high = std::max(high, x);
        }
    };
    scan(value.f8);
    scan(value.i4);
    scan(value.u1);
    const std::string unit = filled(row.unit, content, true);
    const double cap = unit == "m" ? row.max_abs_m : unit == "px" ? row.max_abs_px : infinity;
    if (low < std::max(-cap, row.min) || high > std::min(cap, row.max) || low <= row.above) {
        wrong("corrupt.range", row,
              "runs from " + std::to_string(low) + " to " + std::to_string(high));
    }
}

}  // namespace detail

}  // namespace vfplan::hdf5
