// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// NumPy's arrays as the bindings take and give them.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>

#include <atomic>
#include <cstring>

#include "vfplan/guide.hpp"

namespace nb = nanobind;
using namespace nb::literals;

using Rows = nb::ndarray<const double, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Row = nb::ndarray<const double, nb::shape<3>, nb::c_contig, nb::device::cpu>;
using Numbers = nb::ndarray<const double, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using Places = nb::ndarray<const double, nb::shape<-1, 2>, nb::c_contig, nb::device::cpu>;
using Ids = nb::ndarray<const std::int32_t, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using Triples = nb::ndarray<const std::int32_t, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Flags = nb::ndarray<const std::uint8_t, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using Matrix = nb::ndarray<const double, nb::shape<4, 4>, nb::c_contig, nb::device::cpu>;
using Jacobian = nb::ndarray<const double, nb::shape<3, -1>, nb::c_contig, nb::device::cpu>;

template <class T>
nb::ndarray<nb::numpy, T> array(std::size_t rows, std::size_t columns) {
    T* data = new T[rows * columns + 1];
    nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<T*>(p); });
    const std::size_t shape[2] = {rows, columns};
    return nb::ndarray<nb::numpy, T>(data, columns == 1 ? 1 : 2, shape, owner);
}

inline vfplan::Vec2 place(const Places& rows, std::size_t i) { return {rows(i, 0), rows(i, 1)}; }

// A table as an array that owns the vector's memory.
template <class T>
nb::object array(std::vector<T>&& values, const std::vector<std::size_t>& shape) {
    auto kept = std::make_unique<std::vector<T>>(std::move(values));
    T* data = kept->data();
    nb::capsule owner(kept.release(),
                      [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
    return nb::cast(nb::ndarray<nb::numpy, T>(data, shape.size(), shape.data(), owner));
}

// A number as NumPy holds it in a member of a row.
template <class V>
auto held() {
    if constexpr (std::is_same_v<V, vfplan::Vec3>)
        return double{};
    else if constexpr (std::is_same_v<V, std::uint32_t>)
        return std::int32_t{};
    else if constexpr (std::is_enum_v<V>)
        return std::underlying_type_t<V>{};
    else
        return V{};
}

// An array for each member of the n rows that `row` gives by number, (n, 3) of a position, else
// (n,). Other threads of Python run meanwhile.
template <class F, class... T, class... V>
nb::tuple table(std::size_t n, F&& row, V T::*... member) {
    const auto column = [&]<class M>(M*) {
        using type = decltype(held<M>());
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

// Lines and arcs as NumPy holds them.
inline std::vector<vfplan::Stroke> strokes(const Rows& vertices, const Numbers& bulges,
                                           const Ids& stroke, const Flags& closed) {
    if (bulges.shape(0) != vertices.shape(0) || stroke.shape(0) != vertices.shape(0))
        throw std::invalid_argument("vfplan: a bulge and a stroke a vertex");
    return vfplan::drawn_strokes(vertices.data(), vertices.shape(0), bulges.data(), stroke.data(),
                                 closed.data(), closed.shape(0));
}

namespace nanobind::detail {

inline constexpr std::array rules{"robust", "paper", "exact"};
inline constexpr std::array searches{"auto", "grid", "brute", "editable"};
inline constexpr std::array ends{"stop", "open"};
inline constexpr std::array holds{"at_once", "on_entry"};

// An enumeration whose members Python knows by their names, here in order.
template <class E, const auto& names>
struct by_name {
    NB_TYPE_CASTER(E, const_name("str"))
    bool from_python(handle given, std::uint8_t, cleanup_list*) noexcept {
        const char* text = PyUnicode_AsUTF8(given.ptr());
        if (text == nullptr) return PyErr_Clear(), false;
        const auto* found = std::find(names.begin(), names.end(), std::string_view(text));
        value = static_cast<E>(found - names.begin());
        return found != names.end();
    }
    static handle from_cpp(E member, rv_policy, cleanup_list*) noexcept {
        return PyUnicode_FromString(names[static_cast<std::size_t>(member)]);
    }
};
template <>
struct type_caster<vfplan::Rule> : by_name<vfplan::Rule, rules> {};
template <>
struct type_caster<vfplan::Search> : by_name<vfplan::Search, searches> {};
template <>
struct type_caster<vfplan::Ends> : by_name<vfplan::Ends, ends> {};
template <>
struct type_caster<vfplan::Hold> : by_name<vfplan::Hold, holds> {};

// A position or direction (3,); Python cannot change what it reads.
template <>
struct type_caster<vfplan::Vec3> {
    NB_TYPE_CASTER(vfplan::Vec3, const_name("numpy.typing.NDArray"))
    bool from_python(handle given, std::uint8_t flags, cleanup_list* cleanup) noexcept {
        make_caster<Row> row;
        const bool is_row = row.from_python(given, flags, cleanup);
        if (is_row) std::copy_n(row.value.data(), 3, value.c);
        return is_row;
    }
    static handle from_cpp(const vfplan::Vec3& x, rv_policy, cleanup_list*) noexcept {
        auto row = array<double>(3, 1);
        std::copy_n(x.c, 3, row.data());
        object made = cast(row);
        made.attr("flags").attr("writeable") = false;
        return made.release();
    }
};

}  // namespace nanobind::detail

/// Holds what one thread serves; a call while another is under way is refused.
class ExclusiveUse {
  public:
    ExclusiveUse(const ExclusiveUse&) = delete;
    ExclusiveUse(std::atomic_flag& busy, const char* type, const char* noun) : busy_(busy) {
        if (busy_.test_and_set(std::memory_order_acquire))
            throw std::runtime_error("this " + std::string(type) +
                                     " is in use by another thread: one " + noun +
                                     " serves one thread, make one for each");
    }
    ~ExclusiveUse() { busy_.clear(std::memory_order_release); }

  private:
    std::atomic_flag& busy_;
};
