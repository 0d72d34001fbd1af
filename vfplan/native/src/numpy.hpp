// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// NumPy's arrays as the bindings take and give them.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <atomic>
#include <cstring>
#include <stdexcept>
#include <string>

#include "vfplan/base/vec.hpp"

namespace nb = nanobind;
using namespace nb::literals;

using Rows = nb::ndarray<const double, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Row = nb::ndarray<const double, nb::shape<3>, nb::c_contig, nb::device::cpu>;

template <class T>
nb::ndarray<nb::numpy, T> array(std::size_t rows, std::size_t columns) {
    T* data = new T[rows * columns + 1];
    nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<T*>(p); });
    const std::size_t shape[2] = {rows, columns};
    return nb::ndarray<nb::numpy, T>(data, columns == 1 ? 1 : 2, shape, owner);
}

inline vfplan::Vec3 vec(const Row& r) { return {{r(0), r(1), r(2)}}; }

/// Holds what one thread serves; a call while another is under way is refused.
class ExclusiveUse {
  public:
    ExclusiveUse(std::atomic_flag& busy, const char* type, const char* noun) : busy_(busy) {
        if (busy_.test_and_set(std::memory_order_acquire))
            throw std::runtime_error("this " + std::string(type) +
                                     " is in use by another thread: one " + noun +
                                     " serves one thread, make one for each");
    }
    ~ExclusiveUse() { busy_.clear(std::memory_order_release); }
    ExclusiveUse(const ExclusiveUse&) = delete;
    ExclusiveUse& operator=(const ExclusiveUse&) = delete;

  private:
    std::atomic_flag& busy_;
};
