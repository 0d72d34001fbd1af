// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Bytes -> content: reads an HDF5 file from memory, trusting nothing in it. Deny by default, in
// the order and with the codes of vfplan/bundle/parse.py.
#pragma once

#include <hdf5.h>
#include <hdf5_hl.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <map>
#include <numeric>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "vfplan/hdf5/content.hpp"
#include "vfplan/hdf5/error.hpp"
#include "vfplan/hdf5/fields.hpp"
#include "vfplan/hdf5/handle.hpp"
#include "vfplan/hdf5/schema.hpp"
#include "vfplan/hdf5/skeleton.hpp"
#include "vfplan/hdf5/text.hpp"

namespace vfplan::hdf5 {

namespace detail {

/// One pass over a file.
class Parser {
  public:
    Parser(std::size_t budget, bool newer) : budget_(budget), newer_(newer) {}

    Content read(hid_t root) {
        groups_.emplace("/", root);
        for (const Row& row : rows) {
            if (row.kind != Kind::group) continue;
            if (row.path == "/") {
                check_names(root, row);
            } else {
                read_group(root, row);
            }
        }
        // Attributes first: units and frames of datasets depend on them.
        for (const Kind kind : {Kind::attribute, Kind::dataset}) {
            for (const Row& row : rows) {
                const auto group = groups_.find(split(row).first);
                if (row.kind == kind && group != groups_.end()) take(group->second, row);
            }
        }
        return std::move(content_);
    }

  private:
    void read_group(hid_t root, const Row& row) {
        const std::string name = split(row).second;
        if (linked(root, name)) {
            owned_.push_back(open_object(root, name, row, H5I_GROUP));
            groups_.emplace(row.path, owned_.back().get());
            check_names(owned_.back().get(), row);
        } else if (row.required == Required::always ||
                   (row.required == Required::rendering && groups_.contains("/rendering"))) {
            wrong("corrupt.missing", row, "is missing");
        }
    }

    void take(hid_t group, const Row& row) {
        const std::string name = split(row).second;
        const bool there =
            row.kind == Kind::attribute ? H5Aexists(group, name.c_str()) > 0 : linked(group, name);
        if (!there) {
            if (row.required == Required::always || row.required == Required::group) {
                wrong("corrupt.missing", row, "is missing");
            }
            return;
        }
        Value value = row.kind == Kind::attribute ? scalar_attribute(group, row, name)
                                                  : dataset(group, row, name);
        check_range(value, row, content_);
        content_.put(row.path, std::move(value));
    }

    void check_names(hid_t group, const Row& row) const {
        H5G_info_t info;
        need(H5Gget_info(group, &info) >= 0, row);
        if (info.nlinks > limits::links_per_group) {
            wrong("unsafe.cap", row, std::to_string(info.nlinks) + " links");
        }
        std::vector<std::string> known, attributes;
        for (const Row& other : rows) {
            const auto [parent, name] = split(other);
            if (parent != row.path || other.path == "/") continue;
            (other.kind == Kind::attribute ? attributes : known).push_back(name);
        }
        for (hsize_t i = 0; i < info.nlinks; ++i) check_link(group, i, known, row);
        check_attributes(group, attributes, row);
    }

    void check_link(hid_t group, hsize_t index, const std::vector<std::string>& known,
                    const Row& row) const {
        H5L_info_t link;
        need(H5Lget_info_by_idx(group, ".", H5_INDEX_NAME, H5_ITER_INC, index, &link,
                                H5P_DEFAULT) >= 0,
             row);
        if (link.type != H5L_TYPE_HARD) {
            wrong("unsafe.link", row, "holds a link that is not hard; no other is allowed");
        }
        std::array<char, 1025> name{};
        const auto length = H5Lget_name_by_idx(group, ".", H5_INDEX_NAME, H5_ITER_INC, index,
                                               name.data(), name.size(), H5P_DEFAULT);
        need(length >= 0, row);
        check_known({name.data(), std::min<std::size_t>(static_cast<std::size_t>(length), 1024)},
                    known, row);
    }

    void check_known(std::string_view name, const std::vector<std::string>& known,
                     const Row& row) const {
        if (!newer_ && std::find(known.begin(), known.end(), name) == known.end()) {
            wrong("unsafe.unknown", row, "holds something that this format does not have");
        }
    }

    void check_attributes(hid_t where, const std::vector<std::string>& known,
                          const Row& row) const {
        const int count = H5Aget_num_attrs(where);
        need(count >= 0, row);
        if (static_cast<std::uint64_t>(count) > limits::attributes_per_object) {
            wrong("unsafe.cap", row, std::to_string(count) + " attributes");
        }
        for (int i = 0; i < count; ++i) {
            const Handle attribute(H5Aopen_by_idx(where, ".", H5_INDEX_NAME, H5_ITER_INC,
                                                  static_cast<hsize_t>(i), H5P_DEFAULT,
                                                  H5P_DEFAULT));
            need(attribute.valid(), row);
            std::array<char, 1025> name{};
            const auto length = H5Aget_name(attribute.get(), name.size(), name.data());
            need(length >= 0, row);
            check_known(
                {name.data(), std::min<std::size_t>(static_cast<std::size_t>(length), 1024)}, known,
                row);
        }
    }

    Value dataset(hid_t group, const Row& row, const std::string& name) {
        const Handle dataset = open_object(group, name, row, H5I_DATASET);
        std::vector<std::pair<std::string, std::string>> own;
        if (!row.unit.empty()) own.emplace_back("unit", filled(row.unit, content_, true));
        if (!row.frame.empty()) own.emplace_back("frame", filled(row.frame, content_, false));
        std::vector<std::string> known;
        for (const auto& [key, wanted] : own) known.push_back(key);
        check_attributes(dataset.get(), known, row);
        std::vector<std::size_t> shape = checked_shape(dataset.get(), row);
        const Handle type(H5Dget_type(dataset.get()));
        const std::size_t size = checked_type(type.get(), row);
        check_storage(dataset.get(), shape, size, row);
        for (const auto& [key, wanted] : own) check_own(dataset.get(), row, key, wanted);
        Value value = values(dataset.get(), type.get(), shape, size, row);
        value.shape = std::move(shape);
        return value;
    }

    std::vector<std::size_t> checked_shape(hid_t dataset, const Row& row) {
        const Handle space(H5Dget_space(dataset));
        const std::size_t rank = row.shape[1].empty() ? 1 : 2;
        if (H5Sget_simple_extent_type(space.get()) != H5S_SIMPLE) {
            wrong("corrupt.shape", row, "is not an array");
        }
        if (H5Sget_simple_extent_ndims(space.get()) != static_cast<int>(rank)) {
            wrong("corrupt.shape", row, "has another number of dimensions");
        }
        std::array<hsize_t, 2> dims{}, most{};
        H5Sget_simple_extent_dims(space.get(), dims.data(), most.data());
        if (dims != most) wrong("unsafe.layout", row, "can grow");
        std::vector<std::size_t> shape;
        for (std::size_t i = 0; i < rank; ++i) {
            check_size(dims[i], row.shape[i], row);
            shape.push_back(static_cast<std::size_t>(dims[i]));
        }
        return shape;
    }

    void check_size(hsize_t size, std::string_view wanted, const Row& row) {
        if (is_digit(wanted[0])) {
            if (size != static_cast<hsize_t>(wanted[0] - '0')) {
                wrong("corrupt.shape", row, "has another shape");
            }
            return;
        }
        const auto* cap = std::find_if(sizes.begin(), sizes.end(),
                                       [&](const Size& s) { return s.letter == wanted[0]; });
        if (size < 1 || size > cap->max) {
            wrong("unsafe.cap", row, std::string(wanted) + " is " + std::to_string(size));
        }
        const auto [known, added] = sizes_.try_emplace(wanted[0], size);
        if (known->second != size) {
            wrong("corrupt.shape", row,
                  std::string(wanted) + " is " + std::to_string(size) + " here and " +
                      std::to_string(known->second) + " elsewhere");
        }
    }

    void check_storage(hid_t dataset, const std::vector<std::size_t>& shape, std::size_t itemsize,
                       const Row& row) {
        const Handle dcpl(H5Dget_create_plist(dataset));
        if (H5Pget_layout(dcpl.get()) != H5D_CHUNKED) {
            wrong("unsafe.layout", row, "is not stored in chunks; no other layout is allowed");
        }
        if (H5Pget_external_count(dcpl.get()) != 0) {
            wrong("unsafe.external", row, "is stored in another file");
        }
        unsigned int flags = 0, config = 0;
        std::size_t n_values = 0;
        if (H5Pget_nfilters(dcpl.get()) != 1 ||
            H5Pget_filter2(dcpl.get(), 0, &flags, &n_values, nullptr, 0, nullptr, &config) !=
                H5Z_FILTER_FLETCHER32) {
            wrong("unsafe.filter", row, "must have fletcher32 as its one filter");
        }
        std::array<hsize_t, 2> chunk{1, 1};
        need(H5Pget_chunk(dcpl.get(), 2, chunk.data()) == static_cast<int>(shape.size()), row);
        // Each side is below 2^32 in the file, their product may not be: compare by division.
        const std::uint64_t rows_cap = limits::chunk_bytes / itemsize;
        if (chunk[0] == 0 || chunk[1] == 0 || chunk[0] > rows_cap || chunk[1] > rows_cap ||
            chunk[0] * chunk[1] > rows_cap) {
            wrong("unsafe.cap", row, "has chunks of more bytes than allowed");
        }
        const std::uint64_t stored = chunk[0] * chunk[1] * itemsize + 4;  // and its checksum
        std::uint64_t count = 1;
        for (std::size_t i = 0; i < shape.size(); ++i) {
            count *= (shape[i] + chunk[i] - 1) / chunk[i];
        }
        if (count * stored > budget_) {
            wrong("unsafe.cap", row, "claims more bytes than the file has left");
        }
        budget_ -= count * stored;
        check_chunks(dataset, count, stored, row);
    }

    Content content_;
    std::map<std::string, hid_t, std::less<>> groups_;
    std::vector<Handle> owned_;
    std::map<char, hsize_t> sizes_;
    std::uint64_t budget_;
    bool newer_;
};

/// The version of an open payload, if this reader reads it; true if its minor is newer.
inline bool check_version(hid_t root) {
    const Row text{"/", Kind::attribute, Type::text, Required::always, {}, "", "", "", 0, 0, 0, 0,
                   0};
    if (H5Aexists(root, "format") <= 0 || H5Aexists(root, "version") <= 0) {
        throw BundleError("corrupt.hdf5", "", "no format and version");
    }
    if (scalar_attribute(root, text, "format").string() != format_name) {
        throw BundleError("corrupt.format", "/@format", "is no fixture bundle");
    }
    const std::string version = scalar_attribute(root, text, "version").string();
    int major = 0, minor = 0;
    if (!is_version(version, major, minor)) {
        throw BundleError("corrupt.version", "/@version", "MAJOR.MINOR wanted");
    }
    if (major != 1) {
        throw BundleError("version.major", "/@version",
                          "version " + version + "; this program reads versions 1.x; " +
                              (major < 1 ? "`vfplan migrate OLD.h5 -o NEW.h5` brings it up to date"
                                         : "`pip install --upgrade vfplan` gets a program that "
                                           "reads it"));
    }
    return version != format_version;
}

}  // namespace detail

/// Everything in a payload whose seal is known to be good. The bytes are used in place.
inline Content parse(std::span<unsigned char> payload) {
    detail::check_superblock(payload);
    check_skeleton(payload);
    harden();
    const Handle file(H5LTopen_file_image(
        payload.data(), payload.size(), H5LT_FILE_IMAGE_DONT_COPY | H5LT_FILE_IMAGE_DONT_RELEASE));
    if (!file.valid()) throw BundleError("corrupt.hdf5", "", "libhdf5 cannot open it");
    const Handle root(H5Gopen2(file.get(), "/", H5P_DEFAULT));
    if (!root.valid()) throw BundleError("corrupt.hdf5", "", "libhdf5 cannot open it");
    const bool newer = detail::check_version(root.get());
    return detail::Parser(payload.size(), newer).read(root.get());
}

}  // namespace vfplan::hdf5
