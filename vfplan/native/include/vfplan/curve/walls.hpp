// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// What holds a proxy at rest: the features that touch it, and which of them it may slide along.
#pragma once

#include "vfplan/curve/nearby.hpp"

namespace vfplan::curve {

/// Tangent of a wall towards u.
inline Vec2 ahead(const Vec2& normal, const Vec2& u) noexcept {
    const Vec2 T = left(normal);
    return dot(T, u) < 0 ? -1.0 * T : T;
}

/// A hollow that the proxy fills: it is pushed from all its directions at once.
inline bool full(const Contact& c, const Heights& h) noexcept { return -c.bend * h.filled > 1; }

struct Walls {
    static constexpr int most = 6;  // that are looked at together

    int feature[most], count = 0;
    Contact touch[most];

    /// False where it is there already, or there are too many. A full hollow pushes as much as its
    /// two ends do.
    bool add(const Nearby& near, int what, const Vec2& x) noexcept {
        for (int j = 0; j < count; ++j)
            if (feature[j] == what) return false;
        const Contact c = near.curve()[what].contact(x);
        if (full(c, near.heights())) {
            const Border* ends = near.curve()[what].border;
            const bool one = add(near, ends[0].next, x), other = add(near, ends[1].next, x);
            return one || other;
        }
        if (count == most) return false;
        feature[count] = what;
        touch[count++] = c;
        return true;
    }
    /// The wall along which a step leads nearer to u and into no other; the last met first.
    int free(const Vec2& u) const noexcept {
        for (int i = count - 1; i >= 0; --i) {
            const Vec2 T = ahead(touch[i].normal, u);
            bool open = dot(T, u) > 0;
            for (int j = 0; j < count && open; ++j)
                open = j == i || dot(T, touch[j].normal) > -1e-9;
            if (open) return i;
        }
        return none;
    }
};

}  // namespace vfplan::curve
