// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
#pragma once

#include <hdf5.h>

#include <utility>

namespace vfplan::hdf5 {

/// Owns one libhdf5 identifier, of whatever kind.
class Handle {
  public:
    explicit Handle(hid_t id = H5I_INVALID_HID) : id_(id) {}
    Handle(Handle&& other) noexcept : id_(std::exchange(other.id_, H5I_INVALID_HID)) {}
    Handle& operator=(Handle&& other) noexcept {
        std::swap(id_, other.id_);
        return *this;
    }
    Handle(const Handle&) = delete;
    Handle& operator=(const Handle&) = delete;
    ~Handle() {
        if (id_ >= 0) H5Idec_ref(id_);
    }
    [[nodiscard]] hid_t get() const { return id_; }
    [[nodiscard]] bool valid() const { return id_ >= 0; }

  private:
    hid_t id_;
};

/// Number of hard links to an object, or -1.
inline long link_count(hid_t object) {
#if H5_VERSION_GE(1, 12, 0)
    H5O_info2_t info;
    return H5Oget_info3(object, &info, H5O_INFO_BASIC) < 0 ? -1 : static_cast<long>(info.rc);
#else
    H5O_info_t info;
    return H5Oget_info2(object, &info, H5O_INFO_BASIC) < 0 ? -1 : static_cast<long>(info.rc);
#endif
}

/// Switch off what a hostile file could use: printing, plugins, links into other files.
inline void harden() {
    H5open();
    H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
    H5PLset_loading_state(0);
    if (H5Lis_registered(H5L_TYPE_EXTERNAL) > 0) H5Lunregister(H5L_TYPE_EXTERNAL);
}

}  // namespace vfplan::hdf5
