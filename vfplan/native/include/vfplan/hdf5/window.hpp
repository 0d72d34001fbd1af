// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <utility>

#include "vfplan/hdf5/error.hpp"

namespace vfplan::hdf5::detail {

/// A window on the payload that is never left.
class Window {
  public:
    Window(std::span<const unsigned char> data, std::string where)
        : data_(data), where_(std::move(where)) {}

    std::span<const unsigned char> take(std::uint64_t count) {
        if (count > left()) corrupt("an object header is cut short");
        at_ += static_cast<std::size_t>(count);
        return data_.subspan(at_ - static_cast<std::size_t>(count),
                             static_cast<std::size_t>(count));
    }
    std::uint64_t number(std::size_t width) {
        std::uint64_t value = 0;
        const auto bytes = take(width);
        for (std::size_t i = width; i-- > 0;) value = value << 8 | bytes[i];
        return value;
    }
    void wanted(std::size_t width, std::uint64_t value, const char* what) {
        if (number(width) != value) corrupt(std::string(what) + " is another one");
    }
    void done() const {
        if (left() != 0) corrupt("a header message is too long");
    }
    Window part(std::uint64_t count) { return {take(count), where_}; }

    [[nodiscard]] std::size_t left() const { return data_.size() - at_; }
    [[nodiscard]] std::size_t at() const { return at_; }

    [[noreturn]] void corrupt(const std::string& message) const {
        throw BundleError("corrupt.hdf5", where_, message);
    }
    [[noreturn]] void unsafe(const char* code, const std::string& message) const {
        throw BundleError(code, where_, message);
    }

  private:
    std::span<const unsigned char> data_;
    std::string where_;
    std::size_t at_ = 0;
};

}  // namespace vfplan::hdf5::detail
