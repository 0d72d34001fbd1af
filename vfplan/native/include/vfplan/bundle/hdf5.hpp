// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Just as much of HDF5 as a bundle needs: checksums, links, objects and their attributes.
#pragma once

#include <map>

#include "vfplan/bundle/schema.hpp"

namespace vfplan::bundle::detail {

// The checksum behind each piece of an HDF5 file's metadata: Jenkins' lookup3. The seal covers
// those bytes already, but libhdf5 does not open a file whose checksums are wrong, and no reader is
// to take what another one refuses.

/// Whether a checksum that differs is refused: always, but for fuzzers, which would not get past.
#ifdef FUZZING_BUILD_MODE_UNSAFE_FOR_PRODUCTION
inline constexpr bool sums_count = false;
#else
inline constexpr bool sums_count = true;
#endif

/// Bob Jenkins' hash of 2006 over bytes, begun with 0.
inline std::uint32_t lookup3(View data) {
    const auto turn = [](std::uint32_t x, int n) { return x << n | x >> (32 - n); };
    std::uint32_t a = 0xdeadbeefu + static_cast<std::uint32_t>(data.size()), b = a, c = a;
    const auto add = [&](View part) {
        std::array<std::uint32_t, 3> word{};
        for (std::size_t i = 0; i < part.size(); ++i)
            word[i / 4] += static_cast<std::uint32_t>(part[i]) << (8 * (i % 4));
        a += word[0], b += word[1], c += word[2];
    };
    // The three change places after each step.
    for (; data.size() > 12; data = data.from(12)) {
        add(data.first(12));
        for (const int n : {4, 6, 8, 16, 19, 4})
            std::tie(a, b, c) = std::tuple(b, c + b, (a - c) ^ turn(c, n));
    }
    if (data.size() == 0) return c;
    add(data);
    for (const int n : {14, 11, 25, 16, 4, 14, 24})
        std::tie(a, b, c) = std::tuple(b, (c ^ b) - turn(b, n), a);
    return b;
}

// Links of an HDF5 file: hard ones only. A soft or an external one, which could lead out of the
// file, is refused; that no two lead to one object is seen to where all are known, in content.hpp.

/// What an object has by name: links' addresses, which are not looked at here, or attributes.
template <class T>
using Named = std::map<std::string, T, std::less<>>;

/// Adds one under a name that no other has, UTF-8 that can be shown.
template <class T>
void add(Named<T>& all, std::string_view name, T one, const ByteReader& body,
         std::uint64_t max_count, const char* noun) {
    body.require(!name.empty() && is_utf8(name) && !has_control(name) &&
                     name.find('/') == std::string_view::npos,
                 {"has the name ", Quoted{name}, ", which is none"}, "corrupt.hdf5",
                 "Give it a name that can be shown");
    body.require(all.emplace(name, std::move(one)).second,
                 {"has two ", noun, " of the name ", Quoted{name}});
    body.require(all.size() <= max_count, {"has more than ", max_count, " ", noun}, "unsafe.cap");
}

inline void read_link(ByteReader& body, Named<std::uint64_t>& links) {
    body.expect(1, 1, "version of a link");
    const auto flags = body.number(1);
    body.require((flags & 0x08) == 0 || body.number(1) == 0, {"holds a link that is not hard"},
                 "unsafe.link");
    body.require((flags & ~std::uint64_t{0x1B}) == 0, {"has unknown flags of a link: ", flags});
    body.require((flags & 0x10) == 0 || body.number(1) <= 1, {"has a name of another encoding"});
    const auto name = body.take(body.number(std::size_t{1} << (flags & 3))).text();
    add(links, name, body.number(8), body, limits::links_per_group, "links");
}

// Where an HDF5 file begins, a plain superblock as `h5py` writes it for a bundle, and its object
// headers: only the few messages a bundle needs, each exactly as long as it should be, each block
// under the checksum that it carries.
//
// Structures and numbers: HDF5 File Format Specification 3.0, sections II.A and IV.A.

inline constexpr std::uint64_t nowhere = ~std::uint64_t{0};

/// A payload, and which of its bytes something in it refers to.
class File {
  public:
    explicit File(View data) : data_(data) {}

    /// A part that is there, and that nothing else refers to (seen by `check_unclaimed`).
    View claim(std::uint64_t address, std::uint64_t size, const std::string& where) {
        const View part = within(address, size, where);
        claims_.emplace_back(address, address + size);
        claimed_ += size;
        require(claimed_ <= data_.size(), "unsafe.overlap", where,
                {"refers to more bytes, all in all, than the file has"});
        return part;
    }
    /// A part of metadata without the checksum at its end, which holds.
    View claim_checked(std::uint64_t address, std::uint64_t size, const std::string& where) {
        const View part = claim(address, size, where);
        const bool sound = size >= 4 && lookup3(part.first(part.size() - 4)) ==
                                            number_at(part, part.size() - 4, 4);
        require(size >= 4 && (sound || !sums_count), "corrupt.hdf5", where,
                {"has metadata whose checksum differs"});
        return part.first(part.size() - 4);
    }
    [[nodiscard]] View within(std::uint64_t address, std::uint64_t size,
                              const std::string& where) const {
        require(address <= data_.size() && size <= data_.size() - address, "corrupt.hdf5", where,
                {"refers to bytes outside of the file"});
        return data_.part(static_cast<std::size_t>(address), static_cast<std::size_t>(size));
    }

    /// No byte belongs to two things; what belongs to none, between them, is zero.
    ///
    /// Not so with `unknown` parts, which nobody looked at: their bytes are not known.
    void check_unclaimed(bool unknown) {
        claims_.emplace_back(data_.size(), data_.size());
        std::sort(claims_.begin(), claims_.end());
        std::uint64_t at = 0;
        for (const auto& [first, end] : claims_) {
            require(first >= at, "unsafe.overlap", "",
                    {"the bytes from ", first, " belong to two things"});
            require(unknown || within(at, first - at, "").all_zero(), "unsafe.hole", "",
                    {"bytes ", at, " to ", first,
                     " of the payload belong to nothing and are not zero"});
            at = end;
        }
    }

  private:
    View data_;
    std::vector<std::pair<std::uint64_t, std::uint64_t>> claims_;
    std::uint64_t claimed_ = 0;
};

/// The parts of an attribute, as they are written.
struct Attribute {
    View type, space, data;
};

// Messages that an object has at most once.
inline constexpr std::uint64_t dataspace = 0x01, link_info = 0x02, datatype = 0x03,
                               fill_value = 0x05, data_layout = 0x08, group_info = 0x0A,
                               attribute_info = 0x15;

/// What one object header says.
struct Object {
    std::string path;
    Named<std::uint64_t> links;
    Named<Attribute> attributes;
    std::map<std::uint64_t, View> single;                       // messages, by their kinds
    std::vector<std::pair<std::uint64_t, std::uint64_t>> more;  // blocks in which it goes on

    [[nodiscard]] bool has(std::uint64_t kind) const { return single.contains(kind); }
    [[nodiscard]] bool is_group() const {
        return has(link_info) && !has(dataspace) && !has(datatype) && !has(fill_value) &&
               !has(data_layout);
    }
    [[nodiscard]] bool is_dataset() const {
        return has(dataspace) && has(datatype) && has(data_layout) && links.empty() &&
               !has(link_info) && !has(group_info);
    }
};

/// Link info and attribute info: heap and index must not be there, nor creation order.
inline void read_info(ByteReader& body) {
    body.expect(2, 0, "version and flags of link or attribute info");
    const auto heap = body.number(8), index = body.number(8);
    body.require(heap == nowhere && index == nowhere, {"keeps links or attributes in a heap"},
                 "unsafe.layout");
}

inline void read_group_info(ByteReader& body) {
    body.expect(1, 0, "version of group info");
    const auto flags = body.number(1);
    body.require((flags & ~std::uint64_t{3}) == 0, {"has unknown flags of group info: ", flags});
    body.take(((flags & 1) != 0 ? 4u : 0u) + ((flags & 2) != 0 ? 4u : 0u));
}

inline void read_attribute(ByteReader& body, Named<Attribute>& attributes) {
    body.expect(1, 3, "version of an attribute");
    body.expect(1, 0, "flags of an attribute");
    const auto name = body.number(2), type = body.number(2), space = body.number(2);
    body.require(body.number(1) <= 1, {"has a name of another encoding"});
    const auto ended = body.take(name).text();
    body.require(ended.ends_with('\0'), {"has an attribute without a name"});
    const Attribute attribute{body.take(type), body.take(space), body.take(body.left())};
    add(attributes, ended.substr(0, ended.size() - 1), attribute, body,
        limits::attributes_per_object, "attributes");
}

inline constexpr char nonzero_gap[] = "has a gap in its object header that is not zero";

inline void read_message(std::uint64_t kind, ByteReader& body, Object& object) {
    const auto keep = [&](View message) {
        body.require(object.single.emplace(kind, message).second, {"has a header message twice"});
    };
    switch (kind) {
        case 0x00:
            return body.require(body.take(body.left()).all_zero(), {nonzero_gap});
        case dataspace:
        case datatype:
        case fill_value:
        case data_layout:
            return keep(body.take(body.left()));
        case link_info:
        case attribute_info:
            keep({});
            return read_info(body);
        case group_info:
            keep({});
            return read_group_info(body);
        case 0x06:
            return read_link(body, object.links);
        case 0x0B:
            return body.require(false, {"passes its data through a filter"}, "unsafe.filter");
        case 0x0C:
            return read_attribute(body, object.attributes);
        case 0x10:
            return object.more.push_back({body.number(8), body.number(8)});
        default:
            body.require(false, {"holds header message ", kind, ", which no bundle needs"},
                         "unsafe.message");
    }
}

/// Reads one block's messages.
inline void read_messages(ByteReader block, Object& object) {
    constexpr std::uint64_t empty = 0x00, constant_or_known = 0x05;
    bool has_empty_message = false;
    while (block.left() >= 4) {
        const auto kind = block.number(1), size = block.number(2), flags = block.number(1);
        ByteReader body(block.take(size), object.path);
        body.require((flags & ~constant_or_known) == 0,
                     {"holds a header message with flags ", flags, ", which no bundle needs"},
                     "unsafe.message");
        read_message(kind, body, object);
        has_empty_message = has_empty_message || kind == empty;
        body.expect_end();
    }
    // As libhdf5: a block has an empty message, or a gap too small for one, but not both.
    block.require(block.left() == 0 || !has_empty_message,
                  {"has a gap in its object header beside an empty message"});
    block.require(block.take(block.left()).all_zero(), {nonzero_gap});
}

/// The object header at an address, with all blocks that it goes on in.
inline Object read_object(File& file, std::uint64_t address, std::string path) {
    constexpr std::size_t max_blocks = 64;
    Object object;
    object.path = std::move(path);
    ByteReader head(file.within(address, 16, object.path), object.path);  // no header is shorter
    head.require(head.take(4).text() == "OHDR" && head.number(1) == 2,
                 {"has no object header of version 2"});
    const auto flags = head.number(1);
    head.require((flags & ~std::uint64_t{0x33}) == 0,
                 {"has unknown flags of an object header: ", flags});
    const std::size_t width = std::size_t{1} << (flags & 3);
    const std::size_t front =
        6 + ((flags & 0x20) != 0 ? 16u : 0u) + ((flags & 0x10) != 0 ? 4u : 0u) + width;
    const auto size = number_at(file.within(address, front, object.path), front - width, width);
    head.require(size <= limits::payload_bytes, {"has an object header that is cut short"});
    const View block = file.claim_checked(address, front + size + 4, object.path);
    read_messages(ByteReader(block.from(front), object.path), object);
    for (std::size_t i = 0; i < object.more.size(); ++i) {
        head.require(i < max_blocks, {"has too many header blocks"}, "unsafe.cap");
        const auto [start, length] = object.more[i];
        const View chunk = file.claim_checked(start, length, object.path);
        head.require(chunk.begins("OCHK"), {"has a header block without a signature"});
        read_messages(ByteReader(chunk.from(4), object.path), object);
    }
    return object;
}

/// The address of the root, from a payload's first 48 bytes: a plain superblock, as `libver` v108
/// makes it, but that its end of file is that of the whole bundle, seal included.
inline std::uint64_t root_address(File& file, std::uint64_t file_length) {
    const auto must = [](bool good, Sentence wrong) { require(good, "corrupt.hdf5", "", wrong); };
    const View data = file.claim_checked(0, 48, "");
    must(data.begins(hdf5_signature), {"is no HDF5 file: its signature is missing"});
    must(data[8] == 2 && data[9] == 8 && data[10] == 8 && data[11] == 0,
         {"has a superblock of another version, or with other sizes"});
    must(number_at(data, 12, 8) == 0, {"has another base address than 0"});
    must(number_at(data, 20, 8) == nowhere, {"has a superblock with an extension"});
    const auto end = number_at(data, 28, 8);
    must(end == file_length, {"says that the file ends at ", end, "; it ends at ", file_length});
    return number_at(data, 36, 8);
}

}  // namespace vfplan::bundle::detail
