// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
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

    bool operator==(const Value&) const = default;
    /// What `f` gives of the member of its type.
    template <class F>
    auto visit(const F& f) {
        return type == Type::f8   ? f(f8)
               : type == Type::i4 ? f(i4)
               : type == Type::u1 ? f(u1)
                                  : f(text);
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
    bool operator==(const Content&) const = default;
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
    /// A number that must be there, or one that need not, as it is otherwise.
    [[nodiscard]] double number(std::string_view path) const { return at(path).number(); }
    [[nodiscard]] double number(std::string_view path, double otherwise) const {
        return has(path) ? number(path) : otherwise;
    }
    [[nodiscard]] std::optional<int> integer(std::string_view path) const {
        return has(path) ? std::optional<int>(at(path).i4.front()) : std::nullopt;
    }
    /// Whether anything of a group is there.
    [[nodiscard]] bool has_group(std::string_view group) const {
        return std::any_of(values_.begin(), values_.end(), [&](const auto& value) {
            const std::string& path = value.first;
            return path.size() > group.size() && path.starts_with(group) &&
                   (path[group.size()] == '/' || path[group.size()] == '@');
        });
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
