// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// NumPy's arrays as the bindings take and give them.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>

#include <atomic>
#include <cstring>
#include <stdexcept>

#include "vfplan/base/vec.hpp"

namespace nb = nanobind;
using namespace nb::literals;

using Rows = nb::ndarray<const double, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Row = nb::ndarray<const double, nb::shape<3>, nb::c_contig, nb::device::cpu>;
using Numbers = nb::ndarray<const double, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using Places = nb::ndarray<const double, nb::shape<-1, 2>, nb::c_contig, nb::device::cpu>;
using Ids = nb::ndarray<const std::int32_t, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using Triples = nb::ndarray<const std::int32_t, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Flags = nb::ndarray<const std::uint8_t, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using Jacobian = nb::ndarray<const double, nb::shape<3, -1>, nb::c_contig, nb::device::cpu>;

template <class T>
nb::ndarray<nb::numpy, T> array(std::size_t rows, std::size_t columns) {
    T* data = new T[rows * columns + 1];
    nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<T*>(p); });
    const std::size_t shape[2] = {rows, columns};
    return nb::ndarray<nb::numpy, T>(data, columns == 1 ? 1 : 2, shape, owner);
}

inline vfplan::Vec3 vec(const Row& r) { return {{r(0), r(1), r(2)}}; }

inline vfplan::Vec2 place(const Places& rows, std::size_t i) { return {rows(i, 0), rows(i, 1)}; }

inline std::optional<vfplan::Vec3> vec(const std::optional<Row>& r) {
    return r ? std::optional(vec(*r)) : std::nullopt;
}

// How NumPy holds a member of a row.
template <class V>
struct Held {
    using type = V;
};
template <>
struct Held<vfplan::Vec3> {
    using type = double;
};
template <>
struct Held<std::uint32_t> {
    using type = std::int32_t;
};
template <class V>
    requires std::is_enum_v<V>
struct Held<V> {
    using type = std::underlying_type_t<V>;
};

// An array for each member of the n rows that `row` gives by number, (n, 3) of a position, else
// (n,). Other threads of Python run meanwhile.
template <class F, class... T, class... V>
nb::tuple table(std::size_t n, F&& row, V T::*... member) {
    const auto column = [&]<class M>(M*) {
        using type = typename Held<M>::type;
        return array<type>(n, sizeof(M) / sizeof(type));
    };
    const std::tuple columns{column(static_cast<V*>(nullptr))...};
    {
        nb::gil_scoped_release release;
        for (std::size_t i = 0; i < n; ++i) {
            const auto from = row(i);
            const auto write = [&](void* to, const auto& value) {
                std::memcpy(static_cast<char*>(to) + i * sizeof value, &value, sizeof value);
            };
            std::apply([&](auto&... to) { (write(to.data(), from.*member), ...); }, columns);
        }
    }
    return std::apply([](auto&... arrays) { return nb::make_tuple(arrays...); }, columns);
}

// A position or direction (3,) that Python reads and cannot change.
inline nb::object fixed_row(const vfplan::Vec3& x) {
    auto row = array<double>(3, 1);
    std::memcpy(row.data(), x.c, sizeof x.c);
    nb::object out = nb::cast(row);
    out.attr("flags").attr("writeable") = false;
    return out;
}

// The member of a bound enumeration that has this name.
template <class E>
E named(const nb::str& name) {
    return nb::cast<E>(nb::type<E>().attr(name));
}

template <class E>
nb::object name_of(E member) {
    return nb::cast(member).attr("name");
}

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
