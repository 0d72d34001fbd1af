// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Bytes -> content: reads an HDF5 file from memory, trusting nothing in it. Deny by default: only
// what the format's table names is read, and nothing is allocated on the word of the file alone.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "vfplan/bundle/content.hpp"
#include "vfplan/bundle/finding.hpp"
#include "vfplan/bundle/header.hpp"
#include "vfplan/bundle/schema.hpp"
#include "vfplan/bundle/text.hpp"
#include "vfplan/bundle/values.hpp"

namespace vfplan::bundle {

/// The group a row's thing lies in, and its name there.
inline std::pair<std::string_view, std::string_view> split(const Row& row) {
    const auto cut = row.path.find_last_of(row.kind == Kind::attribute ? '@' : '/');
    const std::string_view parent = row.path.substr(0, cut), name = row.path.substr(cut + 1);
    return {parent.empty() ? std::string_view("/") : parent, name};
}

namespace detail {

/// A unit or frame of a row with "@frame" and "@source_frame" filled in.
inline std::string filled(std::string_view text, const Content& content, bool as_unit) {
    std::string out(text);
    for (const auto& [name, path] : {std::pair{"@frame", "/@frame"},
                                     std::pair{"@source_frame", "/registration@source_frame"}}) {
        const auto at = out.find(name);
        if (at == std::string::npos) continue;
        const Value* frame = content.find(path);
        const std::string known = frame != nullptr ? frame->string() : "?";
        const bool metres = known == "robot_base" || known == "patient_lps";
        out.replace(at, std::string_view(name).size(), as_unit ? (metres ? "m" : "px") : known);
    }
    return out;
}

inline const Row& row_at(std::string_view path) {
    return *std::find_if(rows.begin(), rows.end(),
                         [&](const Row& row) { return row.path == path; });
}

/// The version of an open payload.
inline Version version_of(const Object& root) {
    const auto text = [&](std::string_view path) {
        const Row& row = row_at(path);
        const Attribute* attribute = root.attributes.find(split(row).second);
        require(attribute != nullptr, "corrupt.missing", row, "is missing");
        return scalar_of(*attribute, row).string();
    };
    const std::string format = text("/@format"), version = text("/@version");
    require(format == format_name, "corrupt.format", "/@format",
            "format is " + in_quotes(format) + "; " + in_quotes(format_name) + " wanted");
    Version found;
    require(is_version(version, found), "corrupt.version", "/@version",
            "version is " + in_quotes(version) + "; MAJOR.MINOR wanted");
    return found;
}

/// One pass over a file.
class Reader {
  public:
    /// `file_length`: of the whole bundle, with its seal.
    Reader(View payload, std::uint64_t file_length, Findings& findings)
        : data_(payload), file_(payload), file_length_(file_length), findings_(findings) {}

    /// Everything that the table of the file's version knows.
    Content read() {
        const std::uint64_t address = root_address(file_, data_, file_length_);
        addresses_.insert(address);
        Object root = read_object(file_, address, "/");
        require_group(root, row_at("/"));
        groups_.emplace("/", std::move(root));
        version_ = version_of(groups_.at("/"));
        check_version();
        for (const Kind kind : {Kind::group, Kind::attribute, Kind::dataset}) {
            // Attributes before tables: units and frames of tables depend on them.
            for (const Row& row : rows) {
                if (row.kind == kind && knows(row)) guarded([&] { take(row); });
            }
        }
        if (findings_.sound()) guarded([&] { file_.check_rest(unknown_); });
        return std::move(content_);
    }
    [[nodiscard]] const Version& version() const { return version_; }

  private:
    [[nodiscard]] bool knows(const Row& row) const { return !(version_ < row.since); }
    [[nodiscard]] bool newer() const { return newest < version_; }

    void check_version() const {
        if (version_.major == newest.major) return;
        throw BundleError(
            "version.major", "/@version",
            "version " + std::to_string(version_.major) + "." + std::to_string(version_.minor) +
                "; this program reads versions " + std::to_string(newest.major) + ".x (writes " +
                std::string(format_version) + "); " +
                (version_.major < newest.major
                     ? "`vfplan migrate OLD.h5 -o NEW.h5` brings it up to date"
                     : "`pip install --upgrade vfplan` gets a program that reads it"));
    }

    void guarded(const std::function<void()>& work) {
        try {
            work();
        } catch (const BundleError& error) {
            findings_.add(error);
        }
    }

    void take(const Row& row) {
        if (row.path == "/") return check_names(groups_.at("/"), row);
        const auto group = groups_.find(split(row).first);
        if (group == groups_.end()) return;
        const Object& parent = group->second;
        const std::string_view name = split(row).second;
        const bool is_attribute = row.kind == Kind::attribute;
        const Attribute* attribute = is_attribute ? parent.attributes.find(name) : nullptr;
        const Link* link = is_attribute ? nullptr : parent.links.find(name);
        if (attribute == nullptr && link == nullptr) {
            return require(!must_be_there(row), "corrupt.missing", row, "is missing");
        }
        if (row.kind == Kind::group) return open_group(row, link->address);
        Value value = is_attribute ? scalar_of(*attribute, row) : table(row, link->address);
        check_range(value, row, filled(row.unit, content_, true));
        content_.put(row.path, std::move(value));
    }

    [[nodiscard]] bool must_be_there(const Row& row) const {
        return row.required == Required::always || row.required == Required::group ||
               (row.required == Required::rendering && groups_.count("/rendering") > 0);
    }

    static void require_group(const Object& object, const Row& row) {
        require(object.group && !object.layout && !object.type && !object.space, "corrupt.kind",
                row, "is not a group");
    }

    void open_group(const Row& row, std::uint64_t address) {
        Object object = read_object(file_, address, std::string(row.path));
        require_group(object, row);
        const Object& group = groups_.emplace(row.path, std::move(object)).first->second;
        check_names(group, row);
    }

    /// Every name in a group is known, unless the file is of a newer version; no two links lead
    /// to one object.
    void check_names(const Object& group, const Row& row) {
        const auto has = [&](std::string_view name, bool attribute) {
            return std::any_of(rows.begin(), rows.end(), [&](const Row& other) {
                return knows(other) && (other.kind == Kind::attribute) == attribute &&
                       split(other) == std::pair(row.path, name);
            });
        };
        for (const Link& link : group.links) {
            const bool known = has(link.name, false);
            check_known(known, link.name, row);
            unknown_ = unknown_ || !known;
            require(addresses_.insert(link.address).second, "unsafe.link", row,
                    "holds a second link, " + in_quotes(link.name) + ", to one object");
        }
        for (const Attribute& attribute : group.attributes) {
            check_known(has(attribute.name, true), attribute.name, row);
        }
    }

    void check_known(bool known, std::string_view name, const Row& row) const {
        require(known || newer(), "unsafe.unknown", row,
                "holds " + in_quotes(name) + ", which this format lacks");
    }

    Value table(const Row& row, std::uint64_t address) {
        const Object object = read_object(file_, address, std::string(row.path));
        require(
            !object.group && object.links.empty() && object.layout && object.type && object.space,
            "corrupt.kind", row, "is not a dataset");
        const auto sides = sides_of(*object.space, row);
        check_shape(sides, row);
        Value value = table_of(file_, object, sides, element_size(*object.type, row), row);
        check_own(object, row);
        return value;
    }

    /// A table's own attributes are its unit and its frame, and say what the format says.
    void check_own(const Object& object, const Row& row) {
        Row plain = row;
        plain.type = Type::text;
        for (const Attribute& attribute : object.attributes) {
            const bool known = (attribute.name == "unit" && !row.unit.empty()) ||
                               (attribute.name == "frame" && !row.frame.empty());
            check_known(known, attribute.name, row);
        }
        for (const auto& [name, text] : {std::pair{"unit", filled(row.unit, content_, true)},
                                         std::pair{"frame", filled(row.frame, content_, false)}}) {
            if (text.empty()) continue;
            const Attribute* attribute = object.attributes.find(name);
            require(attribute != nullptr, "corrupt.missing", row,
                    "has no attribute " + in_quotes(name));
            const std::string found = scalar_of(*attribute, plain).string();
            require(found == text, ("corrupt." + std::string(name)).c_str(), row,
                    name + (" is " + in_quotes(found)) + "; " + in_quotes(text) + " wanted");
        }
    }

    void check_shape(const std::vector<std::uint64_t>& sides, const Row& row) {
        const std::size_t rank = row.shape[1].empty() ? 1 : 2;
        require(sides.size() == rank, "corrupt.shape", row,
                "has " + std::to_string(sides.size()) + " dimensions; " + std::to_string(rank) +
                    " wanted");
        for (std::size_t i = 0; i < rank; ++i) check_side(sides[i], row.shape[i], row);
    }

    void check_side(std::uint64_t side, std::string_view wanted, const Row& row) {
        if (is_digit(wanted[0])) {
            return require(
                side == static_cast<std::uint64_t>(wanted[0] - '0'), "corrupt.shape", row,
                "has " + std::to_string(side) + " where " + std::string(wanted) + " is wanted");
        }
        const auto cap = std::find_if(sizes.begin(), sizes.end(), [&](const Size& s) {
                             return s.letter == wanted[0];
                         })->max;
        require(side >= 1 && side <= cap, "unsafe.cap", row,
                std::string(wanted) + " is " + std::to_string(side) + "; 1 to " +
                    std::to_string(cap) + " allowed");
        const auto known = sizes_.emplace(wanted[0], side).first->second;
        require(known == side, "corrupt.shape", row,
                std::string(wanted) + " is " + std::to_string(side) + " here and " +
                    std::to_string(known) + " elsewhere");
    }

    View data_;
    File file_;
    std::uint64_t file_length_;
    Findings& findings_;
    Version version_;
    Content content_;
    std::map<std::string_view, Object> groups_;
    std::set<std::uint64_t> addresses_;
    std::map<char, std::uint64_t> sizes_;
    bool unknown_ = false;
};

}  // namespace detail

}  // namespace vfplan::bundle
