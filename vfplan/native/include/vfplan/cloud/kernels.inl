// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The loops over points, eight at a time. Included by points.hpp once for each width; VFPLAN_LANES
// says how wide the registers are, in float64.

// Eight float64 and what is done with them, in registers of VFPLAN_LANES float64 each.

#define VFPLAN_INLINE __attribute__((always_inline, VFPLAN_TARGET)) inline
#define VFPLAN_LOOP  \
    template <int D> \
    __attribute__((VFPLAN_TARGET))

using Native = double __attribute__((vector_size(8 * VFPLAN_LANES)));
using NativeMask = long long __attribute__((vector_size(8 * VFPLAN_LANES)));
inline constexpr int parts = 8 / VFPLAN_LANES;

// Unrolled, or at -O2 the parts would lie in memory and not in registers.
#define VFPLAN_EACH _Pragma("GCC unroll 4") for (int i = 0; i < parts; ++i)

struct Float8 {
    Native v[parts];

    Float8() = default;
    VFPLAN_INLINE Float8(double x) { VFPLAN_EACH v[i] = Native{} + x; }
};

// Which of the eight: all bits of a lane, or none.
struct Mask {
    NativeMask v[parts];
};

#define VFPLAN_OPERATOR(Result, op, Operand)                 \
    VFPLAN_INLINE Result operator op(Operand a, Operand b) { \
        Result r;                                            \
        VFPLAN_EACH r.v[i] = a.v[i] op b.v[i];               \
        return r;                                            \
    }
VFPLAN_OPERATOR(Float8, +, Float8)
VFPLAN_OPERATOR(Float8, -, Float8)
VFPLAN_OPERATOR(Float8, *, Float8)
VFPLAN_OPERATOR(Mask, <, Float8)
VFPLAN_OPERATOR(Mask, <=, Float8)
VFPLAN_OPERATOR(Mask, >, Float8)
VFPLAN_OPERATOR(Mask, >=, Float8)
VFPLAN_OPERATOR(Mask, &, Mask)
VFPLAN_OPERATOR(Mask, |, Mask)
#undef VFPLAN_OPERATOR

VFPLAN_INLINE Float8 operator-(Float8 a) {
    VFPLAN_EACH a.v[i] = -a.v[i];
    return a;
}
VFPLAN_INLINE Float8& operator+=(Float8& a, Float8 b) { return a = a + b; }
VFPLAN_INLINE Float8& operator-=(Float8& a, Float8 b) { return a = a - b; }

VFPLAN_INLINE Float8 load(const double* p) {
    Float8 a;  // part by part: one copy of the whole would go through narrower registers
    VFPLAN_EACH std::memcpy(&a.v[i], p + VFPLAN_LANES * i, sizeof(Native));
    return a;
}

VFPLAN_INLINE Float8 choose(Mask m, Float8 a, Float8 b) {
    VFPLAN_EACH a.v[i] = m.v[i] ? a.v[i] : b.v[i];
    return a;
}
VFPLAN_INLINE Float8 smaller(Float8 a, Float8 b) { return choose(a < b, a, b); }
VFPLAN_INLINE Float8 larger(Float8 a, Float8 b) { return choose(a > b, a, b); }

VFPLAN_INLINE void store(Float8 a, double* p) {
    VFPLAN_EACH std::memcpy(p + VFPLAN_LANES * i, &a.v[i], sizeof(Native));
}

VFPLAN_INLINE Float8 root(Float8 a) {
#if VFPLAN_LANES == 8
    a.v[0] = (Native)_mm512_maskz_sqrt_pd(0xff, (__m512d)a.v[0]);
#elif VFPLAN_LANES == 4
    VFPLAN_EACH a.v[i] = (Native)_mm256_sqrt_pd((__m256d)a.v[i]);
#else
    double v[8];
    store(a, v);
    for (double& x : v) x = std::sqrt(x);
    a = load(v);
#endif
    return a;
}

// 1/sqrt(a) to 1e-7 by correctly rounded float32 operations: nothing here depends on a processor's
// own approximation. One step of Newton's makes 2e-14 of it.
using Floats = float __attribute__((vector_size(4 * VFPLAN_LANES)));
VFPLAN_INLINE Float8 seed(Float8 a) {
    VFPLAN_EACH {
        Floats f = __builtin_convertvector(a.v[i], Floats);
#if VFPLAN_LANES == 8
        f = (Floats)_mm256_sqrt_ps((__m256)f);
#elif VFPLAN_LANES == 4
        f = (Floats)_mm_sqrt_ps((__m128)f);
#else
        for (int j = 0; j < VFPLAN_LANES; ++j) f[j] = std::sqrt(f[j]);
#endif
        a.v[i] = __builtin_convertvector(1.0f / f, Native);
    }
    return a;
}

VFPLAN_INLINE unsigned bits(Mask m) {
    unsigned b = 0;
#if VFPLAN_LANES == 8
    b = _mm512_movepi64_mask((__m512i)m.v[0]);
#elif VFPLAN_LANES == 4
    VFPLAN_EACH b |= static_cast<unsigned>(_mm256_movemask_pd((__m256d)m.v[i])) << (4 * i);
#else
    VFPLAN_EACH for (int j = 0; j < VFPLAN_LANES; ++j) b |= static_cast<unsigned>(m.v[i][j] & 1)
                                                            << (VFPLAN_LANES * i + j);
#endif
    return b;
}

VFPLAN_INLINE double sum(Float8 a) {
    double v[8];
    store(a, v);
    return ((v[0] + v[4]) + (v[2] + v[6])) + ((v[1] + v[5]) + (v[3] + v[7]));
}

VFPLAN_INLINE double smallest(Float8 a) {
    double v[8];
    store(a, v);
    return *std::min_element(v, v + 8);
}

// Points i .. i+7 of a span relative to x; lanes without a point are far away.
template <int D>
struct PointBlock {
    Float8 d[D];
    Float8 d2;

    VFPLAN_INLINE PointBlock(const PointSpan<D>& in, std::size_t i, const Vec<D>& x) {
        const std::size_t left = in.n - i;
        for (int k = 0; k < D; ++k) d[k] = load(in.c[k] + i) - x.c[k];
        if (left < 8) {
            const Mask there = load(lane_numbers) < static_cast<double>(left);
            for (int k = 0; k < D; ++k) d[k] = choose(there, d[k], Float8(far_away));
        }
        d2 = d[0] * d[0];
        for (int k = 1; k < D; ++k) d2 += d[k] * d[k];
    }
    VFPLAN_INLINE Float8 along(const Vec<D>& v) const {
        Float8 a = d[0] * v.c[0];
        for (int k = 1; k < D; ++k) a += d[k] * v.c[k];
        return a;
    }
};

VFPLAN_LOOP
std::size_t gather(const PointSpan<D>& in, const Vec<D>& x, double reach2, double* const* out) {
    std::size_t n = 0;
    for (std::size_t i = 0; i < in.n; i += 8) {
        const PointBlock<D> b(in, i, x);
        const unsigned within = bits(b.d2 <= reach2);
        // Without a branch that a processor could guess wrong.
#if VFPLAN_LANES == 8
        for (int k = 0; k < D; ++k)
            _mm512_storeu_pd(out[k] + n, _mm512_maskz_compress_pd(static_cast<__mmask8>(within),
                                                                  _mm512_loadu_pd(in.c[k] + i)));
        n += static_cast<unsigned>(__builtin_popcount(within));
#else
        for (unsigned j = 0; j < 8; n += within >> j++ & 1)
            for (int k = 0; k < D; ++k) out[k][n] = in.c[k][i + j];
#endif
    }
    return n;
}

VFPLAN_LOOP
double nearest2(const PointSpan<D>& in, const Vec<D>& x) {
    Float8 m = infinity;
    for (std::size_t i = 0; i < in.n; i += 8) {
        const PointBlock<D> b(in, i, x);
        m = smaller(b.d2, m);
    }
    return smallest(m);
}

// Eqs. (1) and (2) in two passes over a strip: what waits for square roots and divisions, then what
// multiplies. In one pass a processor cannot look far enough ahead to do both at once, and a tick
// takes a fifth longer.
//
// phi / r of a point at distance r is 2 (5/4 w - q) q^4 (2/r) / w^5 with w = 2 (r3 - r1) and
// q = 2 (r3 - r) between 0 and w. Twice r and 1/r come from one step of Newton's on 1/r.
VFPLAN_LOOP
void normal(const PointSpan<D>& in, const Vec<D>& x, double r1, double r3, NormalSum<D>& to) {
    constexpr std::size_t strip = 256;
    alignas(64) double squares[strip], seeds[strip];
    const double w = 2 * (r3 - r1), scale = 2 / (w * w * w * w * w);
    Float8 s[D] = {}, near = to.nearest2;
    for (std::size_t begin = 0; begin < in.n; begin += strip) {
        const std::size_t end = std::min(begin + strip, in.n);
        for (std::size_t i = begin; i < end; i += 8) {
            const PointBlock<D> b(in, i, x);
            near = smaller(b.d2, near);
            store(b.d2, squares + (i - begin));
            store(seed(b.d2), seeds + (i - begin));
        }
        for (std::size_t i = begin; i < end; i += 8) {
            const Float8 d2 = load(squares + (i - begin)), y = load(seeds + (i - begin));
            const Float8 r = d2 * y, newton = 3.0 - r * y;
            const Float8 q = smaller(larger(2 * r3 - r * newton, 0), w), q2 = q * q;
            const Float8 f = (1.25 * w - q) * (y * newton) * (q2 * q2);
            for (int k = 0; k < D; ++k) s[k] -= f * (load(in.c[k] + i) - x.c[k]);
        }
    }
    for (int k = 0; k < D; ++k) to.sum.c[k] += scale * sum(s[k]);
    to.count += in.n;
    to.nearest2 = smallest(near);
}

VFPLAN_LOOP
double first_root_eq3(const PointSpan<D>& in, const Vec<D>& x, const Vec<D>& way, double reach2,
                      double radius2) {
    Float8 nearest_root = infinity;
    for (std::size_t i = 0; i < in.n; i += 8) {
        const PointBlock<D> b(in, i, x);
        const Float8 ahead = b.along(way);
        const Float8 inside = ahead * ahead - b.d2 + radius2;
        const Mask hit = (b.d2 < reach2) & (inside >= 0.0) & (ahead >= 0.0);
        if (bits(hit) == 0) continue;
        const Float8 d0 = ahead - root(choose(hit, inside, 0));
        nearest_root = choose(hit & (d0 >= 0.0) & (d0 < nearest_root), d0, nearest_root);
    }
    return smallest(nearest_root);
}

VFPLAN_LOOP
void distances(const PointSpan<D>& in, const Vec<D>& x, const Vec<D>& hip, double reach2,
               Distances& to) {
    const Vec<D> u = hip - x;
    Float8 to_proxy = 0, to_hip = 0, count = 0;
    for (std::size_t i = 0; i < in.n; i += 8) {
        const PointBlock<D> b(in, i, x);
        const Mask near = b.d2 < reach2;
        if (bits(near) == 0) continue;
        Float8 h2 = (b.d[0] - u.c[0]) * (b.d[0] - u.c[0]);
        for (int k = 1; k < D; ++k) h2 += (b.d[k] - u.c[k]) * (b.d[k] - u.c[k]);
        to_proxy += choose(near, root(b.d2), 0);
        to_hip += choose(near, root(h2), 0);
        count += choose(near, 1, 0);
    }
    to.to_proxy += sum(to_proxy);
    to.to_hip += sum(to_hip);
    to.count += sum(count);
}

VFPLAN_LOOP
double last_root_eq7(const PointSpan<D>& in, const Vec<D>& x, const Vec<D>& n, double entrenched2,
                     double radius2) {
    Float8 largest = -infinity;
    for (std::size_t i = 0; i < in.n; i += 8) {
        const PointBlock<D> b(in, i, x);
        const Mask inside = b.d2 < entrenched2;
        if (bits(inside) == 0) continue;
        const Float8 ahead = b.along(n);
        const Float8 under = ahead * ahead + (radius2 - b.d2);
        const Float8 d = ahead + root(choose(inside, under, 0));
        largest = choose(inside & (d > largest), d, largest);
    }
    return -smallest(-largest);
}

VFPLAN_LOOP
double ray_hit(const PointSpan<D>& in, const Ray<D>& ray) {
    Float8 first = infinity;
    for (std::size_t i = 0; i < in.n; i += 8) {
        const PointBlock<D> b(in, i, ray.from);
        const Float8 ahead = b.along(ray.direction);
        const Float8 outer = ahead * ahead - b.d2 + ray.outer2;
        const Mask front = (ahead > 0.0) & (outer > 0.0);
        if (bits(front) == 0) continue;
        const Float8 inner = ahead * ahead - b.d2 + ray.inner2;
        const Mask steep = (outer > ray.steep2) & (b.d2 > ray.outer2);
        const Mask hit = front & (steep | (inner > 0.0));
        if (bits(hit) == 0) continue;
        const Float8 under = choose(steep, outer, inner);
        const Float8 s = larger(ahead - root(choose(hit, under, 0)), 0);
        first = choose(hit & (s < first), s, first);
    }
    return smallest(first);
}

VFPLAN_LOOP
std::size_t indices_within(const PointSpan<D>& in, const Vec<D>& x, double reach2,
                           std::uint32_t* to) {
    std::size_t n = 0;
    for (std::size_t i = 0; i < in.n; i += 8) {
        const PointBlock<D> b(in, i, x);
        for (unsigned m = bits(b.d2 <= reach2); m != 0; m &= m - 1)
            to[n++] = static_cast<std::uint32_t>(i) + static_cast<std::uint32_t>(__builtin_ctz(m));
    }
    return n;
}

VFPLAN_LOOP
void accumulate_fit(const PointSpan<D>& in, const FitWindow<D>& p, NormalEquations<D>& to) {
    constexpr int terms = NormalEquations<D>::terms, pairs = terms * (terms + 1) / 2;
    const double fall = 1 / (p.outer2 - p.inner2);
    Float8 a[pairs] = {}, z[terms] = {};
    for (std::size_t i = 0; i < in.n; i += 8) {
        const PointBlock<D> b(in, i, p.at);
        const Mask near = b.d2 < p.outer2;
        if (bits(near) == 0) continue;
        const Float8 up = -b.along(p.up);
        const Mask counts = near & (up > 0.0) & (up * up > p.cosine2 * b.d2);
        const Float8 q = choose(counts, smaller((p.outer2 - b.d2) * fall, 1), 0);
        const Float8 w = q * q;
        Float8 f[terms];
        f[0] = 1;
        for (int k = 0; k < D - 1; ++k) f[1 + k] = choose(counts, -b.along(p.side[k]) * p.scale, 0);
        for (int k = 0; k < D - 1; ++k) f[D + k] = f[1 + k] * f[1 + k];
        if constexpr (D == 3) f[5] = f[1] * f[2];
        const Float8 height = choose(counts, (up - p.height) * p.scale, 0);
        for (int r = 0, n = 0; r < terms; ++r) {
            const Float8 wf = w * f[r];
            z[r] += wf * height;
            for (int c = r; c < terms; ++c, ++n) a[n] += wf * f[c];
        }
    }
    for (int n = 0; n < pairs; ++n) to.a[n] += sum(a[n]);
    for (int r = 0; r < terms; ++r) to.z[r] += sum(z[r]);
}

template <int D>
Kernels<D> table() {
    return {gather<D>,        nearest2<D>, normal<D>,         first_root_eq3<D>, distances<D>,
            last_root_eq7<D>, ray_hit<D>,  indices_within<D>, accumulate_fit<D>};
}

#undef VFPLAN_EACH
#undef VFPLAN_INLINE
#undef VFPLAN_LOOP
#undef VFPLAN_LANES
#undef VFPLAN_TARGET
