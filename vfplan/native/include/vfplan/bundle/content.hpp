// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The content of a bundle: every value, by its path in the format.
#pragma once

#include <map>

#include "vfplan/bundle/schema.hpp"
#include "vfplan/bundle/types.hpp"

namespace vfplan::bundle {

/// One value of a bundle: an attribute, which has no shape, or a table. Only the member that
/// belongs to its type holds something.
struct Value {
    Type type = Type::none;
    std::vector<std::size_t> shape;
    std::vector<double> f8;
    std::vector<std::int32_t> i4;
    std::vector<std::uint8_t> u1;
    std::vector<std::string> text;

    bool operator==(const Value&) const = default;
    /// Calls f with the member that belongs to its type.
    template <class F>
    auto visit(const F& f) {
        return type == Type::f8   ? f(f8)
               : type == Type::i4 ? f(i4)
               : type == Type::u1 ? f(u1)
                                  : f(text);
    }
    template <class F>
    auto visit(const F& f) const {
        return const_cast<Value*>(this)->visit([&](const auto& all) { return f(all); });
    }
    [[nodiscard]] const std::string& string() const { return text.front(); }
    [[nodiscard]] double number() const { return f8.front(); }
};

/// Thrown where a value is asked for that is not there; its text is the path.
struct Absent : std::out_of_range {
    using std::out_of_range::out_of_range;
};

/// The row of the format's table for a value or a group; null where the format has none.
inline const Row* row_of(std::string_view path) {
    const auto* row = std::ranges::find(rows, path, &Row::path);
    return row == rows.end() ? nullptr : row;
}

/// The group at the root in which a value lies.
inline std::string_view group_of(std::string_view path) {
    return path.substr(0, path.find_first_of("/@", 1));
}

/// Everything a bundle holds, by its path in the format. Whoever asks for a path that the format
/// does not have gets Absent, and not the answer that nothing is there.
class Content : std::map<std::string, Value, std::less<>> {
  public:
    using map::begin, map::end;
    bool operator==(const Content&) const = default;
    [[nodiscard]] bool has(std::string_view path) const { return find(path) != nullptr; }
    /// Throws Absent if there is no such value.
    [[nodiscard]] const Value& at(std::string_view path) const {
        const Value* value = find(path);
        if (value == nullptr) throw Absent(std::string(path));
        return *value;
    }
    [[nodiscard]] const Value* find(std::string_view path) const {
        const auto found = map::find(path);
        if (found != end()) return &found->second;
        if (row_of(path) == nullptr) throw Absent(std::string(path));
        return nullptr;
    }
    /// A number. Without `otherwise` it must be there, or Absent is thrown.
    [[nodiscard]] double number(std::string_view path, std::optional<double> otherwise = {}) const {
        return otherwise && !has(path) ? *otherwise : at(path).number();
    }
    [[nodiscard]] std::optional<int> integer(std::string_view path) const {
        return has(path) ? std::optional<int>(at(path).i4.front()) : std::nullopt;
    }
    /// Whether any value of a group is there.
    [[nodiscard]] bool has_group(std::string_view group) const {
        if (row_of(group) == nullptr) throw Absent(std::string(group));
        return std::any_of(begin(), end(), [&](const auto& value) {
            return value.first != group && group_of(value.first) == group;
        });
    }
    void put(std::string_view path, Value value) {
        insert_or_assign(std::string(path), std::move(value));
    }
    /// Moves a value out; throws Absent if there is none.
    Value take(std::string_view path) { return std::move(const_cast<Value&>(at(path))); }
};

/// How many doubts of a checked content nobody has answered.
inline std::size_t count_unanswered(const Content& content) {
    if (!content.has("/findings/severity")) return 0;
    const std::vector<std::string>& severity = content.at("/findings/severity").text;
    const Value* by = content.find("/findings/answered_by");
    std::size_t count = 0;
    for (std::size_t i = 0; i < severity.size(); ++i) {
        const bool answered = by != nullptr && !by->text[i].empty();
        if (severity[i] == "doubt" && !answered) ++count;
    }
    return count;
}

namespace detail {

inline std::vector<StrokeRange> strokes_of(const Content& content) {
    std::vector<StrokeRange> strokes;
    for (const std::int32_t id : content.at("/curve/stroke").i4) {
        const auto i = static_cast<std::size_t>(id);
        if (i == strokes.size()) {
            const std::size_t first = i == 0 ? 0 : strokes[i - 1].first + strokes[i - 1].count;
            strokes.push_back({first, 0, content.at("/curve/closed").u1[i] != 0});
        }
        ++strokes[i].count;
    }
    return strokes;
}

/// The lines and arcs of each stroke.
inline std::vector<Stroke> pieces_of(const Content& content) {
    const std::vector<double>& bulges = content.at("/pieces/bulges").f8;
    const std::vector<std::uint8_t>& closed = content.at("/curve/closed").u1;
    return drawn_strokes(content.at("/pieces/vertices").f8.data(), bulges.size(), bulges,
                         content.at("/pieces/stroke").i4, closed, closed.size());
}

}  // namespace detail

}  // namespace vfplan::bundle
