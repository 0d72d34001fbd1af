// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Vectors of two or three coordinates, boxes, the plane across an ignored axis, and how a value
// outside its range is refused.
#pragma once

#include <concepts>
#include <cstdio>
#include <cstdlib>
#include <stdexcept>
#include <tuple>
#include <type_traits>

#include "vfplan/base/compiler.hpp"

namespace vfplan::inline v1 {

/// Throws; in a program without exceptions, prints the reason and aborts.
template <class Error = std::invalid_argument>
[[noreturn]] inline void reject(const std::string& why) {
#ifdef __cpp_exceptions
    throw Error("vfplan: " + why);
#else
    std::fprintf(stderr, "vfplan: %s\n", why.c_str());
    std::abort();
#endif
}

/// A number as messages give it.
inline std::string shown(double x) {
    char digits[32];
    std::snprintf(digits, sizeof digits, "%g", x);
    return digits;
}
/// A setting outside its range, by its name and the value found.
class OutOfRange : public std::invalid_argument {
  public:
    OutOfRange(const char* name, double value, const std::string& why)
        : std::invalid_argument("vfplan: " + why), name(name), value(value) {}

    std::string name;
    double value;
};

/// Throws OutOfRange. `allowed` goes on after "Give", and `why` is the reason for the range.
[[noreturn]] inline void reject_setting(const char* name, double value, const char* unit,
                                        const std::string& allowed, const char* why = "") {
    std::string message = std::string(name) + " is " + shown(value) + unit + ". Give " + allowed;
    if (*why != '\0') message += std::string(" (") + why + ")";
    message += ".";
#ifdef __cpp_exceptions
    throw OutOfRange(name, value, message);
#else
    reject(message);
#endif
}
/// Throws OutOfRange unless the value lies from `least` to `most`.
inline void check_from(const char* name, double value, double least, double most, const char* unit,
                       const char* why = "") {
    if (value >= least && value <= most) return;
    std::string allowed = "a value of at least " + shown(least);
    if (std::isfinite(most)) allowed += " and at most " + shown(most);
    reject_setting(name, value, unit, allowed + unit, why);
}
/// Throws OutOfRange unless the value lies above `bound` and is at most `most`. Infinity is never
/// allowed.
inline void check_above(const char* name, double value, double bound, double most, const char* unit,
                        const char* why = "") {
    if (std::isfinite(value) && value > bound && value <= most) return;
    std::string allowed = "a value above " + shown(bound);
    if (std::isfinite(most)) allowed += " and at most " + shown(most);
    reject_setting(name, value, unit, allowed + unit, why);
}

inline constexpr double infinity = std::numeric_limits<double>::infinity();
inline constexpr double largest_coordinate = 1e6;  // [m]; beyond it float64 loses the nanometre
/// Of a tip or a fixture from the robot's base [m]: one that is further away was given in
/// millimetres.
inline constexpr double largest_distance = 100;

template <int D>
struct Vec;

namespace detail {

/// What other libraries have for D numbers, such as std::array<double, 3> and Eigen::Vector3d: it
/// is indexed, and does not say that it has another number of them, or one that only a program
/// knows.
template <class T, int D>
concept Indexed = !std::is_pointer_v<T> && !std::is_array_v<T> && !std::is_base_of_v<Vec<D>, T> &&
                  requires(const T& t) {
                      { t[0] } -> std::convertible_to<double>;
                  } && [] {
                      if constexpr (requires { std::tuple_size<T>::value; })
                          return std::tuple_size<T>::value == D;
                      else if constexpr (requires { T::SizeAtCompileTime; })
                          return int(T::SizeAtCompileTime) == D;
                      else
                          return !requires(const T & t) { t.size(); };
                  }();

}  // namespace detail

template <int D>
struct Vec {
    static_assert(D == 2 || D == 3);
    double c[D] = {};

    constexpr Vec() noexcept = default;
    /// Vec3{{x, y, z}}
    constexpr Vec(const double (&x)[D]) noexcept {
        for (int k = 0; k < D; ++k) c[k] = x[k];
    }
    constexpr Vec(double x, double y) noexcept
        requires(D == 2)
        : c{x, y} {}
    constexpr Vec(double x, double y, double z) noexcept
        requires(D == 3)
        : c{x, y, z} {}
    template <detail::Indexed<D> T>
    constexpr Vec(const T& x) noexcept {
        for (int k = 0; k < D; ++k) c[k] = x[k];
    }
    template <detail::Indexed<D> T>
        requires std::is_default_constructible_v<T>
    constexpr operator T() const noexcept {
        T x;
        for (int k = 0; k < D; ++k) x[k] = c[k];
        return x;
    }

    Vec operator-() const noexcept { return -1.0 * *this; }
    Vec operator*(double s) const noexcept { return s * *this; }
    Vec operator/(double s) const noexcept { return (1 / s) * *this; }
    Vec& operator+=(const Vec& other) noexcept { return *this = *this + other; }
    Vec& operator-=(const Vec& other) noexcept { return *this = *this - other; }
    Vec& operator*=(double s) noexcept { return *this = s * *this; }

    // A template, so that an index of any integer type is taken as it is.
    template <class Index>
    double& operator[](Index i) noexcept {
        return c[i];
    }
    template <class Index>
    double operator[](Index i) const noexcept {
        return c[i];
    }
};

using Vec2 = Vec<2>;
using Vec3 = Vec<3>;

template <int D>
Vec<D> operator+(const Vec<D>& a, const Vec<D>& b) noexcept {
    Vec<D> r;
    for (int k = 0; k < D; ++k) r.c[k] = a.c[k] + b.c[k];
    return r;
}
template <int D>
Vec<D> operator-(const Vec<D>& a, const Vec<D>& b) noexcept {
    Vec<D> r;
    for (int k = 0; k < D; ++k) r.c[k] = a.c[k] - b.c[k];
    return r;
}
template <int D>
Vec<D> operator*(double s, const Vec<D>& a) noexcept {
    Vec<D> r;
    for (int k = 0; k < D; ++k) r.c[k] = s * a.c[k];
    return r;
}
template <int D>
bool operator==(const Vec<D>& a, const Vec<D>& b) noexcept {
    return std::equal(a.c, a.c + D, b.c);
}
template <int D>
double dot(const Vec<D>& a, const Vec<D>& b) noexcept {
    double sum = a.c[0] * b.c[0];
    for (int k = 1; k < D; ++k) sum += a.c[k] * b.c[k];
    return sum;
}
template <int D>
double norm(const Vec<D>& a) noexcept {
    return std::sqrt(dot(a, a));
}
inline Vec3 cross(const Vec3& a, const Vec3& b) noexcept {
    return {{a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]}};
}
/// Row i of a table of coordinates, x y z of each in turn.
inline Vec3 point_at(const double* xyz, std::size_t i) noexcept {
    return {xyz[3 * i], xyz[3 * i + 1], xyz[3 * i + 2]};
}
/// Counterclockwise by a quarter turn.
inline Vec2 left(const Vec2& v) noexcept { return {-v[1], v[0]}; }
/// Whether each coordinate is finite and within 1e6 m.
inline bool is_within_range(const Vec3& x) noexcept {
    return std::all_of(x.c, x.c + 3, [](double c) { return std::abs(c) <= largest_coordinate; });
}
/// d v / |v|; 0 when v is 0.
template <int D>
Vec<D> along(const Vec<D>& v, double d) noexcept {
    const double length = norm(v);
    return length > 0 ? (d / length) * v : Vec<D>{};
}

/// v, or as much of it as is `most` long.
template <int D>
Vec<D> shortened(const Vec<D>& v, double most) noexcept {
    const double length = norm(v);
    return length > most ? (most / length) * v : v;
}

/// x without its part along a unit vector.
inline Vec3 across(const Vec3& x, const Vec3& axis) noexcept { return x - dot(axis, x) * axis; }

template <int D>
void tangent_frame(const Vec<D>& up, Vec<D> (&side)[D - 1]) noexcept {
    if constexpr (D == 2) {
        side[0] = {{-up.c[1], up.c[0]}};
    } else {
        const auto is_less = [](double a, double b) { return std::abs(a) < std::abs(b); };
        Vec<D> axis;
        axis.c[std::min_element(up.c, up.c + D, is_less) - up.c] = 1;
        side[0] = along(axis - dot(axis, up) * up, 1);
        side[1] = cross(up, side[0]);
    }
}

/// Solves A x = b, whose first n rows count, with the lower triangle of a symmetric A: as L D L^T,
/// of which D is left on the diagonal of `a`, and x in `b`.
template <int N>
void solve_symmetric(double (&a)[N][N], double (&b)[N], int n = N) noexcept {
    for (int r = 0; r < n; ++r) {
        for (int c = 0; c <= r; ++c) {
            for (int k = 0; k < c; ++k) a[r][c] -= a[r][k] * a[c][k] * a[k][k];
            if (c < r) a[r][c] /= a[c][c];
        }
        for (int k = 0; k < r; ++k) b[r] -= a[r][k] * b[k];
    }
    for (int r = n; r-- > 0;) {
        b[r] /= a[r][r];
        for (int k = r + 1; k < n; ++k) b[r] -= a[k][r] * b[k];
    }
}

template <int D>
Vec<D> filled(double c) noexcept {
    Vec<D> v;
    std::fill_n(v.c, D, c);
    return v;
}

template <int D>
struct Box {
    Vec<D> low = filled<D>(infinity), high = filled<D>(-infinity);  ///< nothing at first

    void include(const Box& b) noexcept {
        include(b.low);
        include(b.high);
    }
    void include(const Vec<D>& p) noexcept {
        for (int k = 0; k < D; ++k) {
            low.c[k] = std::min(low.c[k], p.c[k]);
            high.c[k] = std::max(high.c[k], p.c[k]);
        }
    }
    /// Square of the distance from x.
    double distance2(const Vec<D>& x) const noexcept {
        double square = 0;
        for (int k = 0; k < D; ++k) {
            const double gap = std::max({low.c[k] - x.c[k], x.c[k] - high.c[k], 0.0});
            square += gap * gap;
        }
        return square;
    }
    /// Part [a, b] of the way from x along the unit vector `way`, up to `most`, that lies within
    /// `margin` of the box; false when none does.
    bool clip(const Vec<D>& x, const Vec<D>& way, double most, double margin, double& a,
              double& b) const noexcept {
        a = 0;
        b = most;
        for (int k = 0; k < D; ++k) {
            const double to_low = low.c[k] - margin - x.c[k];
            const double to_high = high.c[k] + margin - x.c[k];
            if (way.c[k] == 0) {
                if (to_low > 0 || to_high < 0) return false;
                continue;
            }
            const double s = to_low / way.c[k], t = to_high / way.c[k];
            a = std::max(a, std::min(s, t));
            b = std::min(b, std::max(s, t));
        }
        return a <= b;
    }
};

/// Three coordinates, as given.
struct Space {
    static constexpr int dimension = 3;

    Vec3 project(const Vec3& p) const noexcept { return p; }
    Vec3 direction(const Vec3& v) const noexcept { return v; }
    Vec3 place(const Vec3& q, const Vec3&, const Vec3&) const noexcept { return q; }
};

/// Two coordinates in the plane normal to the unit vector a; along a the proxy goes with the HIP.
struct Slice {
    static constexpr int dimension = 2;
    Vec3 e[2];

    explicit Slice(const Vec3& a) noexcept { tangent_frame(a, e); }
    Vec2 project(const Vec3& p) const noexcept { return {{dot(e[0], p), dot(e[1], p)}}; }
    Vec3 direction(const Vec2& v) const noexcept { return v[0] * e[0] + v[1] * e[1]; }
    /// The proxy at q, where the HIP is at hip, seen across the axis at h.
    Vec3 place(const Vec2& q, const Vec3& hip, const Vec2& h) const noexcept {
        return hip + direction(q - h);
    }
};

/// Eq. (8), K = diag(k); across an ignored axis P K P (proxy - HIP), where one stiffness for all
/// axes leaves nothing along it by itself.
template <class S>
Vec3 spring_force(const Vec3& k, const S& space, const Vec<S::dimension>& across) noexcept {
    const Vec3 d = space.direction(across);
    if (k[0] == k[1] && k[1] == k[2]) return k[0] * d;
    const Vec3 kd{{k[0] * d[0], k[1] * d[1], k[2] * d[2]}};
    return space.direction(space.project(kd));
}

}  // namespace vfplan::inline v1
