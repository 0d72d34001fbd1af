// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "vfplan/bundle/schema.hpp"

namespace vfplan::bundle {

/// One value of a bundle: an attribute (no shape) or a table; only the member of its type is used.
struct Value {
    Type type = Type::none;
    std::vector<std::size_t> shape;
    std::vector<double> f8;
    std::vector<std::int32_t> i4;
    std::vector<std::uint8_t> u1;
    std::vector<std::string> text;

    friend bool operator==(const Value& a, const Value& b) {
        return a.type == b.type && a.shape == b.shape && a.f8 == b.f8 && a.i4 == b.i4 &&
               a.u1 == b.u1 && a.text == b.text;
    }
    [[nodiscard]] const std::string& string() const { return text.front(); }
    [[nodiscard]] double number() const { return f8.front(); }
};

/// A value that is asked for and not there.
class Absent : public std::out_of_range {
  public:
    using std::out_of_range::out_of_range;
};

/// Everything a bundle holds, by its path in the format.
class Content {
  public:
    friend bool operator==(const Content& a, const Content& b) { return a.values_ == b.values_; }
    [[nodiscard]] bool has(std::string_view path) const { return find(path) != nullptr; }
    /// Throws Absent if there is no such value.
    [[nodiscard]] const Value& at(std::string_view path) const {
        const Value* value = find(path);
        if (value == nullptr) throw Absent(std::string(path));
        return *value;
    }
    [[nodiscard]] const Value* find(std::string_view path) const {
        const auto found = values_.find(path);
        return found == values_.end() ? nullptr : &found->second;
    }
    /// Whether anything of a group is there.
    [[nodiscard]] bool has_group(std::string_view group) const {
        for (const auto& [path, value] : values_) {
            if (path.size() > group.size() && path.compare(0, group.size(), group) == 0 &&
                (path[group.size()] == '/' || path[group.size()] == '@')) {
                return true;
            }
        }
        return false;
    }
    void put(std::string_view path, Value value) {
        values_.insert_or_assign(std::string(path), std::move(value));
    }
    /// Moves a value out; throws Absent if there is none.
    Value take(std::string_view path) {
        const auto found = values_.find(path);
        if (found == values_.end()) throw Absent(std::string(path));
        Value value = std::move(found->second);
        values_.erase(found);
        return value;
    }

    [[nodiscard]] auto begin() { return values_.begin(); }
    [[nodiscard]] auto end() { return values_.end(); }

  private:
    std::map<std::string, Value, std::less<>> values_;
};

}  // namespace vfplan::bundle
