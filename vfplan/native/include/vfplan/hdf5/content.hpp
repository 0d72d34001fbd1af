// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "vfplan/hdf5/schema.hpp"

namespace vfplan::hdf5 {

/// One value of a bundle: an attribute (no shape) or a table; only the member of its type is used.
struct Value {
    Type type = Type::none;
    std::vector<std::size_t> shape;
    std::vector<double> f8;
    std::vector<std::int32_t> i4;
    std::vector<std::uint8_t> u1;
    std::vector<std::string> text;

    bool operator==(const Value&) const = default;
    [[nodiscard]] const std::string& string() const { return text.front(); }
    [[nodiscard]] double number() const { return f8.front(); }
};

/// Everything a bundle holds, by its path in the format.
class Content {
  public:
    bool operator==(const Content&) const = default;
    [[nodiscard]] bool has(std::string_view path) const { return values_.contains(path); }
    [[nodiscard]] const Value& at(std::string_view path) const {
        return values_.find(path)->second;
    }
    [[nodiscard]] const Value* find(std::string_view path) const {
        const auto found = values_.find(path);
        return found == values_.end() ? nullptr : &found->second;
    }
    /// Whether anything of a group is there.
    [[nodiscard]] bool has_group(std::string_view group) const {
        for (const auto& [path, value] : values_) {
            if (path.size() > group.size() && path.starts_with(group) &&
                (path[group.size()] == '/' || path[group.size()] == '@')) {
                return true;
            }
        }
        return false;
    }
    void put(std::string_view path, Value value) {
        values_.insert_or_assign(std::string(path), std::move(value));
    }
    Value take(std::string_view path) {
        const auto found = values_.find(path);
        Value value = std::move(found->second);
        values_.erase(found);
        return value;
    }

  private:
    std::map<std::string, Value, std::less<>> values_;
};

}  // namespace vfplan::hdf5
