// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Bytes of a file that are read and never left: nothing here believes a length that a file states.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "vfplan/bundle/finding.hpp"

#if defined(__BYTE_ORDER__) && __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "vfplan reads bundles on little-endian processors only: their numbers are copied as they are"
#endif

namespace vfplan::bundle {

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

/// Reads bytes from front to back; what is wrong is reported at `where`, by BundleError.
class Window {
  public:
    Window(View data, std::string where) : data_(data), where_(std::move(where)) {}

    View take(std::uint64_t count) {
        require(count <= left(), "an object header is cut short");
        at_ += static_cast<std::size_t>(count);
        return data_.part(at_ - static_cast<std::size_t>(count), static_cast<std::size_t>(count));
    }
    std::uint64_t number(std::size_t width) { return number_at(take(width), 0, width); }
    void wanted(std::size_t width, std::uint64_t value, const char* what) {
        const std::uint64_t found = number(width);
        require(found == value, std::string(what) + " is " + std::to_string(found) + "; " +
                                    std::to_string(value) + " wanted");
    }
    void done() const { require(left() == 0, "a header message is too long"); }

    [[nodiscard]] std::size_t left() const { return data_.size() - at_; }
    [[nodiscard]] std::size_t at() const { return at_; }

    void require(bool good, std::string_view message, const char* code = "corrupt.hdf5") const {
        detail::require(good, code, where_, message);
    }

  private:
    View data_;
    std::string where_;
    std::size_t at_ = 0;
};

}  // namespace detail

}  // namespace vfplan::bundle
