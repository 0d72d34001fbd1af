// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The reader of a bundle: every value, compared with its row of the format before it is read.
#pragma once

#include <cstring>
#include <set>

#include "vfplan/bundle/content.hpp"
#include "vfplan/bundle/hdf5.hpp"

namespace vfplan::bundle::detail {

// Datatypes, dataspaces and values of single fields, each compared with its row of the format's
// table before a value is read.

/// The datatype messages of float64, int32 and uint8, little-endian. No other encoding of a number
/// is allowed.
inline std::string_view encoding_of(Type type) {
    using namespace std::string_view_literals;
    if (type == Type::f8) return "\x11\x20\x3f\0\x08\0\0\0\0\0\x40\0\x34\x0b\0\x34\xff\x03\0\0"sv;
    return type == Type::i4 ? "\x10\x08\0\0\x04\0\0\0\0\0\x20\0"sv
                            : "\x10\0\0\0\x01\0\0\0\0\0\x08\0"sv;
}

/// The size in bytes of one element. Its datatype must be that of the row, byte for byte.
inline std::size_t element_size(View message, const Row& row) {
    constexpr std::uint64_t integer = 0, floating = 1, string = 3;
    require(message.size() >= 8, "corrupt.hdf5", row.path, {"has a datatype that is cut short"});
    const std::uint64_t kind = message[0] & 15u, version = message[0] >> 4u;
    require(kind == integer || kind == floating || kind == string, "unsafe.type", row.path,
            {"has a datatype of class ", kind, "; numbers and fixed-length strings are allowed"},
            "Write numbers, or text of a fixed length");
    require(version == 1, "corrupt.hdf5", row.path,
            {"has a datatype of version ", version, "; 1 wanted"});
    const auto size = number_at(message, 4, 4);
    if (row.type != Type::text) {
        require(message.text() == encoding_of(row.type), "corrupt.type", row.path,
                {"has another type than ", type_names[static_cast<std::size_t>(row.type)]});
        return static_cast<std::size_t>(size);
    }
    require(kind == string, "unsafe.type", row.path, {"is not a fixed-length string"},
            "Write text of a fixed length");
    const std::uint64_t padding = message[1] & 15u, encoding = message[1] >> 4u;
    require(message.size() == 8 && encoding <= 1 && message[2] == 0 && message[3] == 0 && size > 0,
            "corrupt.type", row.path, {"is text of another encoding"});
    require(padding <= 1, "corrupt.type", row.path, {"is text padded with blanks"},
            "Pad it with NUL");
    require(size <= limits::text_bytes, "unsafe.cap", row.path,
            {"is text of ", size, " bytes; at most ", limits::text_bytes, " allowed"});
    return static_cast<std::size_t>(size);
}

/// The sides of an array; a scalar has none.
inline std::vector<std::uint64_t> sides_of(View message, const Row& row) {
    constexpr std::uint64_t scalar = 0, simple = 1;
    ByteReader body(message, std::string(row.path));
    body.expect(1, 2, "version of a dataspace");
    const auto rank = body.number(1), flags = body.number(1), kind = body.number(1);
    const bool array = kind == simple && rank > 0;
    require(rank <= 3 && flags <= 1 && (array || (kind == scalar && rank == 0 && flags == 0)),
            "corrupt.shape", row.path, {"has a dataspace of kind ", kind, ", rank ", rank});
    std::vector<std::uint64_t> sides, max_sides;
    for (std::uint64_t i = 0; i < rank; ++i) sides.push_back(body.number(8));
    for (std::uint64_t i = 0; i < rank * flags; ++i) max_sides.push_back(body.number(8));
    body.expect_end();
    require(flags == 0 || sides == max_sides, "unsafe.layout", row.path, {"can grow"},
            "Write an array of fixed size");
    return sides;
}

/// The text of a field without the NUL bytes that fill it up.
inline std::string text_of(View raw, const Row& row) {
    std::size_t size = raw.size();
    while (size > 0 && raw[size - 1] == 0) --size;
    const std::string_view text = raw.first(size).text();
    require(is_utf8(text), "corrupt.text", row.path, {"is not UTF-8"});
    require(!has_control(text), "corrupt.text", row.path, {"holds control characters"});
    return std::string(text);
}

/// A value of this shape from bytes, `size` of them for each element.
inline Value value_of(View raw, std::vector<std::size_t> shape, std::size_t size, const Row& row) {
    const std::size_t count = raw.size() / size;
    Value value;
    value.type = row.type;
    value.shape = std::move(shape);
    value.visit([&]<class T>(std::vector<T>& all) {
        all.resize(count);
        if constexpr (std::is_arithmetic_v<T>)
            std::memcpy(all.data(), raw.data(), raw.size());
        else
            for (std::size_t i = 0; i < count; ++i) all[i] = text_of(raw.part(i * size, size), row);
    });
    return value;
}

/// Refuses an object whose fill value is not zero.
inline void check_fill(const Object& object, std::size_t element) {
    if (!object.has(fill_value)) return;
    ByteReader body(object.single.at(fill_value), object.path);
    body.expect(1, 3, "version of a fill value");
    const auto flags = body.number(1);
    const auto size = (flags & 0x20) != 0 ? body.number(4) : 0;
    const View value = body.take(size);
    body.require((flags & 0xC0) == 0 && (flags & 0x30) != 0x30 && (size == 0 || size == element) &&
                     value.all_zero(),
                 {"has another fill value than zero"});
    body.expect_end();
}

/// The bytes of a table, which must stand in one piece and be as many as its shape and type need.
inline View data_of(File& file, const Object& object, std::uint64_t bytes, const Row& row) {
    constexpr std::uint64_t contiguous = 1;
    ByteReader layout(object.single.at(data_layout), object.path);
    layout.require(layout.number(1) == 3 && layout.number(1) == contiguous,
                   {"is not stored in one piece"}, "unsafe.layout");
    const auto address = layout.number(8), size = layout.number(8);
    layout.expect_end();
    require(address != nowhere, "corrupt.storage", row.path, {"has no data"});
    require(size == bytes, "corrupt.storage", row.path,
            {"has ", size, " bytes of data; its shape and type need ", bytes});
    return file.claim(address, size, object.path);
}

/// A scalar attribute of a row's type.
inline Value scalar_of(const Attribute& attribute, const Row& row) {
    require(sides_of(attribute.space, row).empty(), "corrupt.shape", row.path, {"is not a scalar"},
            "Write a single value");
    const std::size_t size = element_size(attribute.type, row);
    require(attribute.data.size() == size, "corrupt.hdf5", row.path,
            {"has ", attribute.data.size(), " bytes; ", size, " wanted"});
    return value_of(attribute.data, {}, size, row);
}

/// Refuses a value outside of its row's range, which may depend on its unit.
inline void check_range(const Value& value, const Row& row, std::string_view unit) {
    for (const std::string& text : value.text)
        require(row.allowed.empty() || holds(split(row.allowed, '|'), text), "corrupt.value",
                row.path, {"is ", Quoted{text}, "; one of ", row.allowed, " allowed"});
    double low = infinity, high = -infinity;
    bool is_finite = true;
    value.visit([&]<class T>(const std::vector<T>& numbers) {
        if constexpr (std::is_arithmetic_v<T>)
            for (const double x : numbers) {
                is_finite = is_finite && std::isfinite(x);
                low = std::min(low, x);
                high = std::max(high, x);
            }
    });
    require(is_finite, "corrupt.value", row.path, {"holds a number that is not finite"},
            "Write finite numbers");
    double cap = infinity;
    if (unit == "m") cap = row.max_abs_m;
    if (unit == "px") cap = row.max_abs_px;
    const double lowest = std::max(-cap, row.min), highest = std::min(cap, row.max);
    require(low >= lowest && high <= highest, "corrupt.range", row.path,
            {"runs from ", low, " to ", high, "; ", lowest, " to ", highest, " allowed"});
    require(low > row.above, "corrupt.range", row.path,
            {"is ", low, "; more than ", row.above, " wanted"});
}

// Reads an HDF5 file from memory and trusts nothing in it. Only what the format's table names is
// read, and no memory is taken because the file alone says so.

/// The group in which a row's value or group lies, and its name there.
inline std::pair<std::string_view, std::string_view> parent_and_name(const Row& row) {
    const auto cut = row.path.find_last_of(row.kind == Kind::attribute ? '@' : '/');
    const std::string_view parent = row.path.substr(0, cut), name = row.path.substr(cut + 1);
    return {parent.empty() ? std::string_view("/") : parent, name};
}

/// The unit or the frame of a row, with the file's own frames in place of "@frame" and
/// "@source_frame".
inline std::string with_frame_names(std::string_view text, const Content& content, bool as_unit) {
    std::string out(text);
    for (const std::string_view path : {"/@frame", "/registration@source_frame"}) {
        const std::string_view name = path.substr(path.find('@'));
        const auto at = out.find(name);
        if (at == std::string::npos) continue;
        const Value* frame = content.find(path);
        const std::string known = frame != nullptr ? frame->string() : "?";
        const bool metres = known == "robot_base" || known == "patient_lps";
        out.replace(at, name.size(), as_unit ? (metres ? "m" : "px") : known);
    }
    return out;
}

/// Refuses another major version of the format; whether it is a newer minor one.
inline bool is_newer(const Object& root) {
    const auto text = [&](std::string_view path) {
        const Row& row = *row_of(path);
        const auto attribute = root.attributes.find(parent_and_name(row).second);
        require(attribute != root.attributes.end(), "corrupt.missing", row.path, {"is missing"});
        return scalar_of(attribute->second, row).string();
    };
    const std::string format = text("/@format"), version = text("/@version");
    require(format == format_name, "corrupt.format", "/@format",
            {"format is ", Quoted{format}, "; ", Quoted{format_name}, " wanted"});
    Version found{};
    require(is_version(version, found), "corrupt.version", "/@version",
            {"version is ", Quoted{version}, "; MAJOR.MINOR wanted"});
    std::string_view todo = "Get a program that reads it: pip install --upgrade vfplan";
    if (found < newest) todo = "Plan it anew, or get the program that wrote it";
    require(found[0] == newest[0], "version.major", "/@version",
            {"has version ", version, "; this program reads versions ", newest[0], ".x and writes ",
             format_version},
            todo);
    return newest < found;
}

/// Reads one file, row after row of the format's table.
class Reader {
  public:
    /// `file_length` is that of the whole bundle, with its seal.
    Reader(View payload, std::uint64_t file_length, Findings& findings)
        : file_(payload), file_length_(file_length), findings_(findings) {}

    /// All values that the table knows in the version of the file.
    Content read() {
        const std::uint64_t address = root_address(file_, file_length_);
        addresses_.insert(address);
        open_group(*row_of("/"), address);
        is_newer_ = is_newer(groups_.at("/"));
        for (const Kind kind : {Kind::group, Kind::attribute, Kind::dataset}) {
            // Attributes before tables: units and frames of tables depend on them.
            for (const Row& row : rows)
                if (row.kind == kind) findings_.collect([&] { read_row(row); });
        }
        if (findings_.sound()) findings_.collect([&] { file_.check_unclaimed(unknown_); });
        return std::move(content_);
    }

  private:
    /// Reads what one row of the format's table names.
    void read_row(const Row& row) {
        if (row.path == "/") return check_names(row);
        const auto [parent, name] = parent_and_name(row);
        const auto group = groups_.find(parent);
        if (group == groups_.end()) return;  // its own row has reported that it is missing
        const Object& object = group->second;
        if (row.kind == Kind::attribute) {
            const auto attribute = object.attributes.find(name);
            if (attribute == object.attributes.end()) return check_absence(row);
            return keep(row, scalar_of(attribute->second, row));
        }
        const auto link = object.links.find(name);
        if (link == object.links.end()) return check_absence(row);
        if (row.kind == Kind::dataset) return keep(row, table(row, link->second));
        open_group(row, link->second);
        check_names(row);
    }

    /// Makes a value that lies within its row's range part of the content.
    void keep(const Row& row, Value value) {
        check_range(value, row, with_frame_names(row.unit, content_, true));
        content_.put(row.path, std::move(value));
    }

    void check_absence(const Row& row) const {
        const bool may_miss =
            row.required == Required::optional ||
            (row.required == Required::rendering && !groups_.contains("/rendering"));
        require(may_miss, "corrupt.missing", row.path, {"is missing"});
    }

    void open_group(const Row& row, std::uint64_t address) {
        Object object = read_object(file_, address, std::string(row.path));
        require(object.is_group(), "corrupt.kind", row.path, {"is not a group"});
        groups_.emplace(row.path, std::move(object));
    }

    /// Refuses a name that the table does not know, unless the file is of a newer version, and a
    /// second link to one object.
    void check_names(const Row& row) {
        const Object& group = groups_.at(row.path);
        const auto has = [&](std::string_view name, bool attribute) {
            return std::ranges::any_of(rows, [&](const Row& other) {
                return (other.kind == Kind::attribute) == attribute &&
                       parent_and_name(other) == std::pair(row.path, name);
            });
        };
        for (const auto& [name, address] : group.links) {
            const bool known = has(name, false);
            check_known(known, name, row);
            unknown_ = unknown_ || !known;
            require(addresses_.insert(address).second, "unsafe.link", row.path,
                    {"holds a second link, ", Quoted{name}, ", to one object"});
        }
        for (const auto& [name, attribute] : group.attributes)
            check_known(has(name, true), name, row);
    }

    void check_known(bool known, std::string_view name, const Row& row) const {
        require(known || is_newer_, "unsafe.unknown", row.path,
                {"holds ", Quoted{name}, ", which this format lacks"});
    }

    Value table(const Row& row, std::uint64_t address) {
        const Object object = read_object(file_, address, std::string(row.path));
        require(object.is_dataset(), "corrupt.kind", row.path, {"is not a dataset"});
        const auto sides = sides_of(object.single.at(dataspace), row);
        check_shape(sides, row);
        const std::size_t element = element_size(object.single.at(datatype), row);
        check_fill(object, element);
        std::uint64_t bytes = element;  // which cannot overflow: sides and texts are limited
        for (const auto side : sides) bytes *= side;
        const View data = data_of(file_, object, bytes, row);
        Value value = value_of(data, {sides.begin(), sides.end()}, element, row);
        check_unit_and_frame(object, row);
        return value;
    }

    /// Refuses a table whose unit or frame is another than the format's, and any other attribute.
    void check_unit_and_frame(const Object& object, const Row& row) {
        Row plain = row;
        plain.type = Type::text;
        for (const auto& [name, attribute] : object.attributes)
            check_known(
                (name == "unit" && !row.unit.empty()) || (name == "frame" && !row.frame.empty()),
                name, row);
        for (const auto& [name, text] :
             {std::pair{"unit", with_frame_names(row.unit, content_, true)},
              std::pair{"frame", with_frame_names(row.frame, content_, false)}}) {
            if (text.empty()) continue;
            const auto attribute = object.attributes.find(name);
            require(attribute != object.attributes.end(), "corrupt.missing", row.path,
                    {"has no attribute ", Quoted{name}});
            const std::string found = scalar_of(attribute->second, plain).string();
            require(found == text, "corrupt." + std::string(name), row.path,
                    {name, " is ", Quoted{found}, "; ", Quoted{text}, " wanted"});
        }
    }

    void check_shape(const std::vector<std::uint64_t>& sides, const Row& row) {
        const std::size_t rank = row.shape[1].empty() ? 1 : 2;
        require(sides.size() == rank, "corrupt.shape", row.path,
                {"has ", sides.size(), " dimensions; ", rank, " wanted"});
        for (std::size_t i = 0; i < rank; ++i) {
            const std::string_view wanted = row.shape[i];
            const auto* size = std::ranges::find(sizes, wanted[0], &Size::letter);
            if (size == sizes.end()) {
                require(std::to_string(sides[i]) == wanted, "corrupt.shape", row.path,
                        {"has a side of ", sides[i], "; ", wanted, " wanted"});
                continue;
            }
            require(sides[i] >= 1 && sides[i] <= size->max, "unsafe.cap", row.path,
                    {wanted, " is ", sides[i], "; 1 to ", size->max, " allowed"});
            const auto known = sizes_.emplace(wanted[0], sides[i]).first->second;
            require(known == sides[i], "corrupt.shape", row.path,
                    {wanted, " is ", sides[i], " here and ", known, " elsewhere"});
        }
    }

    File file_;
    std::uint64_t file_length_;
    Findings& findings_;
    bool is_newer_ = false;
    Content content_;
    std::map<std::string_view, Object> groups_;
    std::set<std::uint64_t> addresses_;
    std::map<char, std::uint64_t> sizes_;
    bool unknown_ = false;
};

}  // namespace vfplan::bundle::detail
