// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Links of an HDF5 file: hard ones only. A soft or an external one, which could lead out of the
// file, is refused; that no two lead to one object is seen to where all are known, in parse.hpp.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "vfplan/bundle/bytes.hpp"
#include "vfplan/bundle/text.hpp"

namespace vfplan::bundle::detail {

struct Link {
    std::string name;
    std::uint64_t address;
};

/// The name of a link or an attribute: UTF-8 that can be shown.
inline void check_name(const Window& body, std::string_view name) {
    body.require(!name.empty() && is_utf8(name) && !has_control(name) &&
                     name.find('/') == std::string_view::npos,
                 "has the name " + in_quotes(name) + ", which is none");
}

/// A link message; its address is not looked at here.
inline Link read_link(Window& body) {
    body.wanted(1, 1, "version of a link");
    const auto flags = body.number(1);
    body.require((flags & 0x08) == 0 || body.number(1) == 0,
                 "holds a link that is not hard; no other is allowed", "unsafe.link");
    body.require((flags & ~std::uint64_t{0x1B}) == 0, "link flags");
    body.require((flags & 0x10) == 0 || body.number(1) <= 1, "has a name of another encoding");
    const auto name = body.take(body.number(std::size_t{1} << (flags & 3))).text();
    check_name(body, name);
    return {std::string(name), body.number(8)};
}

}  // namespace vfplan::bundle::detail
