// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// A look at a payload's bones before libhdf5 gets it; the same rules, in the same order, as
// vfplan/bundle/skeleton.py: every object header that will be used, and the index of its chunks.
//
// Structures and numbers: HDF5 File Format Specification 3.0, sections III.C and III.D.
#pragma once

#include <algorithm>
#include <cstdint>
#include <deque>
#include <set>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "vfplan/hdf5/header.hpp"
#include "vfplan/hdf5/schema.hpp"
#include "vfplan/hdf5/window.hpp"

namespace vfplan::hdf5 {

namespace detail {

/// The index of a dataset's chunks has their number, and lies within the file.
inline void check_index(std::span<const unsigned char> data, Window layout, std::uint64_t flags,
                        std::uint64_t chunks, std::uint64_t stored, const std::string& path) {
    constexpr std::uint64_t single_chunk = 1, fixed_array = 3;
    const auto index = layout.number(1);
    if (index == single_chunk) {
        if (flags != 2 || layout.number(8) != stored || layout.number(4) != 0 || chunks != 1) {
            layout.corrupt("has a chunk of another size");
        }
        within(data, layout.number(8), stored, path);
    } else if (index == fixed_array) {
        const auto page_bits = layout.number(1), address = layout.number(8);
        Window head(within(data, address, 28, path), path);
        const auto signature = head.take(6);
        if (flags != 0 ||
            std::string(signature.begin(), signature.end()) != std::string("FAHD\0\1", 6)) {
            layout.corrupt("has no index of filtered chunks");
        }
        const auto entry = head.number(1);
        if (entry < 13 || entry > 20 || head.number(1) != page_bits || page_bits < 1 ||
            page_bits > 20) {
            layout.corrupt("has an index of another form");
        }
        if (head.number(8) != chunks || chunks > limits::chunks_per_dataset) {
            layout.unsafe("unsafe.cap", "has an index of another length");
        }
        const auto start = head.number(8);
        Window block(within(data, start, 14 + chunks * entry + 4, path), path);
        const auto begin = block.take(6);
        if (std::string(begin.begin(), begin.end()) != std::string("FADB\0\1", 6) ||
            block.number(8) != address) {
            layout.corrupt("has an index without its block");
        }
    } else {
        layout.unsafe("unsafe.layout", "has a chunk index of another kind");
    }
    layout.done();
}

inline void check_dataset(std::span<const unsigned char> data, const HeaderFacts& found,
                          const std::string& path) {
    Window layout = *found.layout;
    if (layout.number(1) != 4 || layout.number(1) != 2) {
        layout.unsafe("unsafe.layout", "is not stored in chunks as libver v110 does");
    }
    if (!found.shape || !found.size ||
        (found.fill && *found.fill != 0 && *found.fill != *found.size)) {
        layout.corrupt("has no plain dataspace, datatype and fill value");
    }
    if (!found.filtered) layout.unsafe("unsafe.filter", "must have fletcher32 as its one filter");
    const auto flags = layout.number(1), dimensions = layout.number(1), width = layout.number(1);
    if ((flags & ~std::uint64_t{2}) != 0 || dimensions != found.shape->size() + 1 || width < 1 ||
        width > 8) {
        layout.corrupt("has a chunk of another form than its dataspace");
    }
    std::uint64_t chunk_bytes = 1, chunks = 1;
    std::vector<std::uint64_t> sides;
    bool empty = false;
    for (std::uint64_t i = 0; i < dimensions; ++i) {
        sides.push_back(layout.number(width));
        empty = empty || sides.back() == 0;
        chunk_bytes = product(chunk_bytes, sides.back());
    }
    if (empty || sides.back() != *found.size) layout.corrupt("has chunks of another shape");
    if (chunk_bytes > limits::chunk_bytes) {
        layout.unsafe("unsafe.cap", "has chunks of " + std::to_string(chunk_bytes) + " bytes");
    }
    for (std::size_t i = 0; i < found.shape->size(); ++i) {
        const std::uint64_t size = (*found.shape)[i];
        chunks = product(chunks, size / sides[i] + (size % sides[i] != 0 ? 1 : 0));
    }
    check_index(data, layout, flags, chunks, chunk_bytes + 4, path);
}

}  // namespace detail

/// Refuses a payload, whose superblock was checked, if its object headers are not plain ones.
inline void check_skeleton(std::span<const unsigned char> data) {
    std::deque<std::pair<std::string, std::uint64_t>> waiting;
    waiting.emplace_back("/", detail::Window(data.subspan(36), "/").number(8));
    std::set<std::uint64_t> seen;
    for (; !waiting.empty(); waiting.pop_front()) {
        const auto [path, address] = waiting.front();
        if (!seen.insert(address).second) continue;  // a second link to it: refused by the reader
        const detail::HeaderFacts found = detail::read_object(data, address, path);
        if (found.layout) detail::check_dataset(data, found, path);
        for (const auto& [name, where] : found.links) {
            const std::string full = (path == "/" ? path : path + "/") + name;
            const bool known = std::any_of(rows.begin(), rows.end(), [&](const Row& row) {
                return row.kind != Kind::attribute && row.path == full;
            });
            if (known) waiting.emplace_back(full, where);
        }
    }
}

}  // namespace vfplan::hdf5
