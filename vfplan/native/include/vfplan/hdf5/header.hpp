// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Object headers of an HDF5 file, read by ourselves, as vfplan/bundle/header.py does: only the few
// messages a bundle needs, each exactly as long as it should be. libhdf5 was not made for hostile
// files: headers whose checksums are right and whose content is not can make it divide by zero.
//
// Structures and numbers: HDF5 File Format Specification 3.0, section IV.A.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "vfplan/hdf5/error.hpp"
#include "vfplan/hdf5/schema.hpp"
#include "vfplan/hdf5/window.hpp"

namespace vfplan::hdf5::detail {

/// What one object header says.
struct HeaderFacts {
    std::vector<std::pair<std::string, std::uint64_t>> links;
    std::vector<std::string> attributes;
    std::optional<std::vector<std::uint64_t>> shape;
    std::optional<std::uint64_t> size, fill;
    std::optional<Window> layout;
    bool filtered = false;
};

inline constexpr std::uint64_t nowhere = ~std::uint64_t{0};

inline std::span<const unsigned char> within(std::span<const unsigned char> data,
                                             std::uint64_t address, std::uint64_t size,
                                             const std::string& where) {
    if (address > data.size() || size > data.size() - address) {
        throw BundleError("corrupt.hdf5", where, "an object header lies outside of the file");
    }
    return data.subspan(static_cast<std::size_t>(address), static_cast<std::size_t>(size));
}

inline std::uint64_t product(std::uint64_t a, std::uint64_t b) {
    return b != 0 && a > nowhere / b ? nowhere : a * b;
}

/// (shape, number of elements, or more than any bundle has)
inline std::pair<std::vector<std::uint64_t>, std::uint64_t> dataspace_of(Window& body) {
    body.wanted(1, 2, "version of a dataspace");
    const auto rank = body.number(1), flags = body.number(1), kind = body.number(1);
    if (rank > 3 || flags > 1 || kind > 2 || (kind != 1 && rank != 0)) {
        body.corrupt("dataspace of another form");
    }
    std::vector<std::uint64_t> shape, most;
    for (std::uint64_t i = 0; i < rank; ++i) shape.push_back(body.number(8));
    for (std::uint64_t i = 0; i < rank * flags; ++i) most.push_back(body.number(8));
    if (flags != 0 && shape != most) body.unsafe("unsafe.layout", "can grow");
    std::uint64_t count = kind == 2 ? 0 : 1;
    for (const std::uint64_t side : shape) count = product(count, side);
    return {shape, count};
}

/// The size of a plain datatype in bytes.
inline std::uint64_t datatype_size(Window& body) {
    constexpr std::uint64_t fixed = 0, floating = 1, string = 3;
    const auto head = body.number(1);
    const auto kind = head & 15, version = head >> 4;
    if (kind != fixed && kind != floating && kind != string) {
        body.unsafe("unsafe.type", "has a datatype of class " + std::to_string(kind));
    }
    if (version < 1 || version > 3) body.corrupt("datatype of another version");
    const auto bits = body.number(3), size = body.number(4);
    if (kind == string && ((bits & 15) > 2 || bits >> 4 > 1)) {
        body.corrupt("has text of another padding or encoding");
    }
    if (size == 0) body.corrupt("has a datatype without size");
    if (kind != string) {
        if (size > 16) body.corrupt("has a number of " + std::to_string(size) + " bytes");
        const auto offset = body.number(2), precision = body.number(2);
        if (precision == 0 || offset + precision > 8 * size) {
            body.corrupt("has a number with bits outside of it");
        }
    }
    if (kind == floating) body.take(8);
    return size;
}

/// Link info and attribute info: heap and index must not be there, nor creation order.
inline void read_info(Window& body) {
    body.wanted(2, 0, "version and flags of link or attribute info");
    const auto heap = body.number(8), index = body.number(8);
    if (heap != nowhere || index != nowhere) {
        body.unsafe("unsafe.layout", "keeps links or attributes in a heap");
    }
}

inline void read_group_info(Window& body) {
    body.wanted(1, 0, "version of group info");
    const auto flags = body.number(1);
    body.take(((flags & 1) != 0 ? 4u : 0u) + ((flags & 2) != 0 ? 4u : 0u));
}

inline void read_fill(Window& body, HeaderFacts& found) {
    if (found.fill) body.corrupt("has a header message twice");
    body.wanted(1, 3, "version of a fill value");
    const auto flags = body.number(1);
    found.fill = (flags & 0x20) != 0 ? body.number(4) : 0;
    body.take(*found.fill);
    if ((flags & 0xC0) != 0 || (flags & 0x30) == 0x30) body.corrupt("fill value flags");
}

inline void read_link(Window& body, HeaderFacts& found) {
    body.wanted(1, 1, "version of a link");
    const auto flags = body.number(1);
    if ((flags & 0x08) != 0 && body.number(1) != 0) {
        body.unsafe("unsafe.link", "holds a link that is not hard; no other is allowed");
    }
    if ((flags & ~std::uint64_t{0x1B}) != 0) body.corrupt("link flags");
    body.take((flags & 0x10) != 0 ? 1 : 0);
    const auto bytes = body.take(body.number(std::size_t{1} << (flags & 3)));
    std::string name(bytes.begin(), bytes.end());
    const bool twice = std::any_of(found.links.begin(), found.links.end(),
                                   [&](const auto& link) { return link.first == name; });
    if (name.empty() || name.find('\0') != std::string::npos ||
        name.find('/') != std::string::npos || twice) {
        body.corrupt("has a link of no name, or two of the same");
    }
    found.links.emplace_back(std::move(name), body.number(8));
    if (found.links.size() > limits::links_per_group) {
        body.unsafe("unsafe.cap", "has too many links");
    }
}

inline void read_filters(Window& body, HeaderFacts& found) {
    if (found.filtered) body.corrupt("has a header message twice");
    body.wanted(1, 2, "version of a filter pipeline");
    if (body.number(1) != 1 || body.number(2) != 3) {
        body.unsafe("unsafe.filter", "must have fletcher32 as its one filter");
    }
    body.take(2);
    body.take(4 * body.number(2));
    found.filtered = true;
}

inline void read_attribute(Window& body, HeaderFacts& found) {
    body.wanted(1, 3, "version of an attribute");
    body.wanted(1, 0, "flags of an attribute");
    const auto name = body.number(2), datatype = body.number(2), dataspace = body.number(2);
    body.take(1);
    const auto bytes = body.take(name);
    std::string text(bytes.begin(), bytes.end());
    if (text.size() < 2 || text.find('\0') != text.size() - 1 ||
        std::find(found.attributes.begin(), found.attributes.end(), text) !=
            found.attributes.end()) {
        body.corrupt("has an attribute of no name, or two of the same");
    }
    found.attributes.push_back(std::move(text));
    if (found.attributes.size() > limits::attributes_per_object) {
        body.unsafe("unsafe.cap", "has too many attributes");
    }
    Window type = body.part(datatype);
    const auto size = datatype_size(type);
    type.done();
    Window space = body.part(dataspace);
    const auto count = dataspace_of(space).second;
    space.done();
    if (product(count, size) != body.left()) body.corrupt("has an attribute of another size");
    body.take(body.left());
}

inline void read_message(std::uint64_t kind, Window& body, HeaderFacts& found) {
    const auto once = [&](bool there) {
        if (there) body.corrupt("has a header message twice");
    };
    switch (kind) {
        case 0x01:
            once(found.shape.has_value());
            found.shape = dataspace_of(body).first;
            return;
        case 0x03:
            once(found.size.has_value());
            found.size = datatype_size(body);
            return;
        case 0x08:
            once(found.layout.has_value());
            found.layout = body.part(body.left());
            return;
        case 0x02:
        case 0x15:
            return read_info(body);
        case 0x05:
            return read_fill(body, found);
        case 0x06:
            return read_link(body, found);
        case 0x0A:
            return read_group_info(body);
        case 0x0B:
            return read_filters(body, found);
        default:
            return read_attribute(body, found);
    }
}

inline bool is_known_message(std::uint64_t kind) {
    constexpr std::array<std::uint64_t, 12> known{0x00, 0x01, 0x02, 0x03, 0x05, 0x06,
                                                  0x08, 0x0A, 0x0B, 0x0C, 0x10, 0x15};
    return std::find(known.begin(), known.end(), kind) != known.end();
}

/// Reads one block's messages; adds to `blocks` where its header goes on.
inline void read_messages(std::span<const unsigned char> data, Window block,
                          const std::string& path, HeaderFacts& found,
                          std::deque<std::span<const unsigned char>>& blocks) {
    constexpr std::uint64_t nil = 0x00, continuation = 0x10, message_flags = 0x05;
    std::vector<std::pair<std::uint64_t, std::uint64_t>> more;
    bool nil_seen = false;
    while (block.left() >= 4) {
        const auto kind = block.number(1), size = block.number(2), flags = block.number(1);
        Window body = block.part(size);
        if ((flags & ~message_flags) != 0 || !is_known_message(kind)) {
            body.unsafe("unsafe.message",
                        "holds message " + std::to_string(kind) + ", which no bundle needs");
        }
        if (kind == nil) {
            nil_seen = true;
            continue;
        }
        if (kind == continuation) {
            const auto start = body.number(8);
            more.emplace_back(start, body.number(8));
        } else {
            read_message(kind, body, found);
        }
        body.done();
    }
    const auto gap = block.take(block.left());
    if ((nil_seen && !gap.empty()) ||
        std::any_of(gap.begin(), gap.end(), [](unsigned char c) { return c != 0; })) {
        block.corrupt("has a gap in its object header");
    }
    for (const auto& [start, length] : more) {
        const auto chunk = within(data, start, length, path);
        if (length < 8 || std::string(chunk.begin(), chunk.begin() + 4) != "OCHK") {
            block.corrupt("a header block has no signature");
        }
        blocks.push_back(chunk.subspan(4, chunk.size() - 8));
    }
}

inline HeaderFacts read_object(std::span<const unsigned char> data, std::uint64_t address,
                               const std::string& path) {
    constexpr std::size_t most_blocks = 64;
    const std::uint64_t there = address < data.size() ? data.size() - address : 0;
    Window head(within(data, address, std::min<std::uint64_t>(32, there), path), path);
    const auto signature = head.take(4);
    if (std::string(signature.begin(), signature.end()) != "OHDR" || head.number(1) != 2) {
        head.corrupt("has no object header of version 2");
    }
    const auto flags = head.number(1);
    if ((flags & ~std::uint64_t{0x33}) != 0) head.corrupt("object header flags");
    head.take(((flags & 0x20) != 0 ? 16u : 0u) + ((flags & 0x10) != 0 ? 4u : 0u));
    const auto size = head.number(std::size_t{1} << (flags & 3));
    HeaderFacts found;
    std::deque<std::span<const unsigned char>> blocks{
        within(data, address + head.at(), size, path)};
    for (std::size_t i = 0; i < blocks.size(); ++i) {
        if (i == most_blocks) head.unsafe("unsafe.cap", "has too many header blocks");
        read_messages(data, Window(blocks[i], path), path, found, blocks);
    }
    return found;
}

}  // namespace vfplan::hdf5::detail
