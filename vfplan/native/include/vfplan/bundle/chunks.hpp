// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Tables of an HDF5 file: chunks under fletcher32, found through a single chunk's address or a
// fixed array of addresses, as libver v110 writes them.
//
// Structures and numbers: HDF5 File Format Specification 3.0, sections III.C and IV.A.2.i.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "vfplan/bundle/bytes.hpp"
#include "vfplan/bundle/checksum.hpp"
#include "vfplan/bundle/content.hpp"
#include "vfplan/bundle/header.hpp"
#include "vfplan/bundle/values.hpp"

namespace vfplan::bundle::detail {

inline constexpr std::uint64_t fletcher_bytes = 4;

/// a * b, or more than any file has.
inline std::uint64_t product(std::uint64_t a, std::uint64_t b) {
    return b != 0 && a > nowhere / b ? nowhere : a * b;
}

/// How a table is cut into chunks: rows and columns of the table and of a chunk.
struct Chunking {
    std::array<std::uint64_t, 2> table{1, 1}, chunk{1, 1};
    std::size_t element = 0;  // bytes

    [[nodiscard]] std::uint64_t count(std::size_t side) const {
        return table[side] / chunk[side] + (table[side] % chunk[side] != 0 ? 1 : 0);
    }
    [[nodiscard]] std::uint64_t count() const { return product(count(0), count(1)); }
    [[nodiscard]] std::uint64_t bytes() const {
        return product(product(chunk[0], chunk[1]), element);
    }
};

/// The addresses in a fixed array of filtered chunks.
class FixedArray {
  public:
    FixedArray(File& file, const std::string& where) : file_(file), where_(where) {}

    std::vector<std::uint64_t> addresses(Window& layout, const Chunking& cut) {
        const auto page_bits = layout.number(1), address = layout.number(8);
        const View head = file_.claim_checked(address, 28, where_);
        entry_ = static_cast<std::size_t>(head[6]);
        layout.require(head.begins(std::string_view("FAHD\0\1", 6)) && entry_ >= 13 &&
                           entry_ <= 20 && head[7] == page_bits && page_bits >= 1 &&
                           page_bits <= 20,
                       "has an index of another form");
        const std::uint64_t count = number_at(head, 8, 8), block = number_at(head, 16, 8);
        layout.require(count == cut.count(),
                       "has an index of " + std::to_string(count) + " chunks; " +
                           std::to_string(cut.count()) + " wanted",
                       "unsafe.cap");
        const std::uint64_t page = std::uint64_t{1} << page_bits;
        stored_ = cut.bytes() + fletcher_bytes;
        if (count <= page) {
            const View all = file_.claim_checked(block, 14 + count * entry_ + 4, where_);
            check_block(all, address);
            read_entries(all.from(14));
        } else {
            read_pages(block, address, count, page);
        }
        return std::move(addresses_);
    }

  private:
    void check_block(View block, std::uint64_t address) const {
        require(block.begins(std::string_view("FADB\0\1", 6)) && number_at(block, 6, 8) == address,
                "corrupt.hdf5", where_, "has an index without its block");
    }
    /// Behind the block's head: a bit for each page that says that it is there, then the pages.
    void read_pages(std::uint64_t block, std::uint64_t address, std::uint64_t count,
                    std::uint64_t page) {
        const std::uint64_t pages = (count + page - 1) / page, bits = (pages + 7) / 8;
        const View head = file_.claim_checked(block, 14 + bits + 4, where_);
        check_block(head, address);
        for (std::uint64_t i = 0; i < 8 * bits; ++i) {
            const bool there = (head[static_cast<std::size_t>(14 + i / 8)] >> (7 - i % 8) & 1) != 0;
            require(there == (i < pages), "corrupt.storage", where_,
                    "has an index without all its pages");
        }
        std::uint64_t at = block + head.size() + 4;
        for (std::uint64_t i = 0; i < pages; ++i) {
            const std::uint64_t size = std::min(page, count - i * page) * entry_ + 4;
            read_entries(file_.claim_checked(at, size, where_));
            at += size;
        }
    }
    void read_entries(View entries) {
        for (; entries.size() >= entry_; entries = entries.from(entry_)) {
            const auto size = number_at(entries, 8, entry_ - 12);
            const auto mask = number_at(entries, entry_ - 4, 4);
            addresses_.push_back(number_at(entries, 0, 8));
            require(addresses_.back() != nowhere, "corrupt.storage", where_,
                    "has a chunk that is not there");
            require(mask == 0 && size == stored_, "unsafe.filter", where_,
                    "has a chunk that did not pass fletcher32");
        }
    }

    File& file_;
    const std::string& where_;
    std::vector<std::uint64_t> addresses_;
    std::size_t entry_ = 0;
    std::uint64_t stored_ = 0;
};

/// Refuses a table with a fill value other than zeros, or another filter than fletcher32.
inline void check_fill_and_filter(const Object& object, std::size_t element, const Row& row) {
    if (object.fill) {
        Window body(*object.fill, object.path);
        body.wanted(1, 3, "version of a fill value");
        const auto flags = body.number(1);
        const auto size = (flags & 0x20) != 0 ? body.number(4) : 0;
        const View value = body.take(size);
        body.require((flags & 0xC0) == 0 && (flags & 0x30) != 0x30 &&
                         (size == 0 || size == element) && value.all_zero(),
                     "has another fill value than zero");
        body.done();
    }
    // Version 2, one filter: fletcher32, by its number and with no parameters.
    const std::string_view text = object.filter ? object.filter->text() : std::string_view();
    constexpr std::string_view mandatory{"\2\1\3\0\0\0\0\0", 8}, optional{"\2\1\3\0\1\0\0\0", 8};
    require(text == mandatory || text == optional, "unsafe.filter", row,
            "must have fletcher32 as its one filter");
}

/// How a table is cut, and where its chunks are, from its layout message.
inline std::vector<std::uint64_t> chunk_addresses(File& file, const Object& object, Chunking& cut,
                                                  std::size_t rank, const Row& row) {
    constexpr std::uint64_t single = 1, fixed_array = 3;
    Window layout(*object.layout, object.path);
    layout.require(layout.number(1) == 4 && layout.number(1) == 2,
                   "is not stored in chunks as libver v110 does; no other layout is allowed",
                   "unsafe.layout");
    const auto flags = layout.number(1), dimensions = layout.number(1), width = layout.number(1);
    layout.require(
        (flags & ~std::uint64_t{2}) == 0 && dimensions == rank + 1 && width >= 1 && width <= 8,
        "has a chunk of another form than its dataspace");
    for (std::size_t i = 0; i < rank; ++i) cut.chunk[i] = layout.number(width);
    const bool some = cut.chunk[0] > 0 && cut.chunk[1] > 0;
    const bool within = cut.chunk[0] <= cut.table[0] && cut.chunk[1] <= cut.table[1];
    layout.require(layout.number(width) == cut.element && some && within,
                   "has chunks of another shape");
    require(cut.bytes() <= limits::chunk_bytes, "unsafe.cap", row,
            "has chunks of " + std::to_string(cut.bytes()) + " bytes; at most " +
                std::to_string(limits::chunk_bytes) + " allowed");
    require(cut.count() <= limits::chunks_per_dataset, "unsafe.cap", row,
            "has " + std::to_string(cut.count()) + " chunks; at most " +
                std::to_string(limits::chunks_per_dataset) + " allowed");
    std::vector<std::uint64_t> addresses;
    const auto index = layout.number(1);
    if (index == single) {
        const auto size = layout.number(8), mask = layout.number(4);
        addresses.push_back(layout.number(8));
        require(mask == 0, "unsafe.filter", row, "has a chunk that did not pass fletcher32");
        layout.require(flags == 2 && size == cut.bytes() + fletcher_bytes && cut.count() == 1,
                       "has a chunk of another size");
    } else {
        layout.require(index == fixed_array && flags == 0,
                       "has a chunk index of kind " + std::to_string(index), "unsafe.layout");
        addresses = FixedArray(file, object.path).addresses(layout, cut);
    }
    layout.done();
    return addresses;
}

/// The bytes of a chunk, whose checksum holds.
inline View chunk_at(File& file, std::uint64_t address, const Chunking& cut, const Row& row) {
    const View stored = file.claim(address, cut.bytes() + fletcher_bytes, std::string(row.path));
    const View chunk = stored.first(stored.size() - fletcher_bytes);
    require(!sums_count || fletcher32(chunk) == number_at(stored, chunk.size(), fletcher_bytes),
            "corrupt.checksum", row, "has a chunk whose checksum differs");
    return chunk;
}

/// Puts the elements of chunk `index` into their places; what lies beyond the table's edge is zero.
inline void scatter(View chunk, std::size_t index, const Chunking& cut, Value& value,
                    const Row& row) {
    const auto across = static_cast<std::size_t>(cut.count(1));
    const std::array<std::size_t, 2> at{index / across, index % across};
    const auto side = [&](std::size_t k) {
        return static_cast<std::size_t>(
            std::min(cut.chunk[k], cut.table[k] - at[k] * cut.chunk[k]));
    };
    const auto whole = static_cast<std::size_t>(cut.table[1]);
    const std::size_t stride = static_cast<std::size_t>(cut.chunk[1]) * cut.element;
    const std::size_t first = at[0] * static_cast<std::size_t>(cut.chunk[0]) * whole +
                              at[1] * static_cast<std::size_t>(cut.chunk[1]);
    const auto need_zeros = [&](View rest) {
        require(rest.all_zero(), "unsafe.hole", row,
                "has something in a chunk beyond the table's edge");
    };
    need_zeros(chunk.from(side(0) * stride));
    if (cut.chunk[1] == whole) {
        return fill(value, first, chunk.first(side(0) * stride), cut.element, row);
    }
    const std::size_t length = side(1) * cut.element;
    for (std::size_t i = 0; i < side(0); ++i) {
        fill(value, first + i * whole, chunk.part(i * stride, length), cut.element, row);
        need_zeros(chunk.part(i * stride + length, stride - length));
    }
}

/// Every element of a table of this shape, whose datatype is known to be the row's.
inline Value table_of(File& file, const Object& object, Chunking cut, std::size_t rank,
                      const Row& row) {
    check_fill_and_filter(object, cut.element, row);
    const auto addresses = chunk_addresses(file, object, cut, rank, row);
    require(product(addresses.size(), cut.bytes() + fletcher_bytes) <= limits::payload_bytes,
            "unsafe.cap", row, "claims more bytes than a file may have");
    std::vector<View> chunks;
    for (const auto address : addresses) chunks.push_back(chunk_at(file, address, cut, row));
    Value value = room_for(row, static_cast<std::size_t>(cut.table[0] * cut.table[1]));
    for (std::size_t i = 0; i < chunks.size(); ++i) scatter(chunks[i], i, cut, value, row);
    return value;
}

}  // namespace vfplan::bundle::detail
