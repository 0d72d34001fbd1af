// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The space the proxy moves in: all of it, or the plane across an ignored axis, where points, HIP
// and proxy have two coordinates.
#pragma once

#include "vfplan/vec.hpp"

namespace vfplan {

/// Three coordinates, as given.
struct Space {
    static constexpr int dimension = 3;

    Vec3 across(const Vec3& p) const noexcept { return p; }
    Vec3 direction(const Vec3& v) const noexcept { return v; }
    Vec3 place(const Vec3& q, const Vec3&, const Vec3&) const noexcept { return q; }
};

/// Two coordinates in the plane normal to the unit vector a; along a the proxy goes with the HIP.
struct Slice {
    static constexpr int dimension = 2;
    Vec3 e1, e2;

    explicit Slice(const Vec3& a) noexcept {
        int least = 0;
        for (int k = 1; k < 3; ++k)
            if (std::abs(a[k]) < std::abs(a[least])) least = k;
        Vec3 axis;
        axis[least] = 1;
        e1 = axis - dot(a, axis) * a;
        e1 = (1 / norm(e1)) * e1;
        e2 = cross(a, e1);
    }
    Vec2 across(const Vec3& p) const noexcept { return {{dot(e1, p), dot(e2, p)}}; }
    Vec3 direction(const Vec2& v) const noexcept { return v[0] * e1 + v[1] * e2; }
    /// The proxy at q, where the HIP is at hip, seen across the axis at h.
    Vec3 place(const Vec2& q, const Vec3& hip, const Vec2& h) const noexcept {
        return hip + direction(q - h);
    }
};

/// Eq. (8), K = diag(k); across an ignored axis P K P (proxy - HIP), where one stiffness for all
/// axes leaves nothing along it by itself.
struct Stiffness {
    Vec3 k;

    template <class S>
    Vec3 force(const S& space, const Vec<S::dimension>& across) const noexcept {
        const Vec3 d = space.direction(across);
        if (k[0] == k[1] && k[1] == k[2]) return k[0] * d;
        const Vec3 kd{{k[0] * d[0], k[1] * d[1], k[2] * d[2]}};
        return space.direction(space.across(kd));
    }
};

}  // namespace vfplan
