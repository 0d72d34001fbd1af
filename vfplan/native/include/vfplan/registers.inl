// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Eight float64 and what is done with them, in registers of VFPLAN_LANES float64 each. Included by
// lanes.inl once for each width.

#define VFPLAN_INLINE [[gnu::always_inline]] inline

using Native = double __attribute__((vector_size(8 * VFPLAN_LANES)));
using NativeMask = long long __attribute__((vector_size(8 * VFPLAN_LANES)));
inline constexpr int parts = 8 / VFPLAN_LANES;

struct Lanes {
    Native v[parts];
};

#define VFPLAN_EACH for (int i = 0; i < parts; ++i)
#define VFPLAN_ARITHMETIC(op)                       \
    VFPLAN_INLINE Lanes operator op(Lanes a, Lanes b) { \
        VFPLAN_EACH a.v[i] = a.v[i] op b.v[i];      \
        return a;                                   \
    }                                               \
    VFPLAN_INLINE Lanes operator op(Lanes a, double b) { \
        VFPLAN_EACH a.v[i] = a.v[i] op b;           \
        return a;                                   \
    }                                               \
    VFPLAN_INLINE Lanes operator op(double a, Lanes b) { \
        VFPLAN_EACH b.v[i] = a op b.v[i];           \
        return b;                                   \
    }
VFPLAN_ARITHMETIC(+)
VFPLAN_ARITHMETIC(-)
VFPLAN_ARITHMETIC(*)
#undef VFPLAN_ARITHMETIC

VFPLAN_INLINE Lanes operator-(Lanes a) {
    VFPLAN_EACH a.v[i] = -a.v[i];
    return a;
}
VFPLAN_INLINE Lanes& operator+=(Lanes& a, Lanes b) { return a = a + b; }
VFPLAN_INLINE Lanes& operator-=(Lanes& a, Lanes b) { return a = a - b; }

VFPLAN_INLINE Lanes all(double x) {
    Lanes a;
    VFPLAN_EACH a.v[i] = Native{} + x;
    return a;
}
VFPLAN_INLINE Lanes load(const double* p) {
    Lanes a;  // part by part: one copy of the whole would go through narrower registers
    VFPLAN_EACH std::memcpy(&a.v[i], p + VFPLAN_LANES * i, sizeof(Native));
    return a;
}

// Which of the eight: all bits of a lane, or none.
struct Mask {
    NativeMask v[parts];
};
#define VFPLAN_COMPARISON(op)                            \
    VFPLAN_INLINE Mask operator op(Lanes a, Lanes b) {   \
        Mask m;                                          \
        VFPLAN_EACH m.v[i] = a.v[i] op b.v[i];           \
        return m;                                        \
    }                                                    \
    VFPLAN_INLINE Mask operator op(Lanes a, double b) { return a op all(b); }
VFPLAN_COMPARISON(<)
VFPLAN_COMPARISON(<=)
VFPLAN_COMPARISON(>)
VFPLAN_COMPARISON(>=)
#undef VFPLAN_COMPARISON

VFPLAN_INLINE Mask operator&(Mask a, Mask b) {
    VFPLAN_EACH a.v[i] &= b.v[i];
    return a;
}
VFPLAN_INLINE Mask operator|(Mask a, Mask b) {
    VFPLAN_EACH a.v[i] |= b.v[i];
    return a;
}
VFPLAN_INLINE Lanes choose(Mask m, Lanes a, Lanes b) {
    VFPLAN_EACH a.v[i] = m.v[i] ? a.v[i] : b.v[i];
    return a;
}
#if VFPLAN_LANES == 8  // where a mask would cost a tenth of a tick
VFPLAN_INLINE Lanes smaller(Lanes a, Lanes b) {
    return {{(Native)_mm512_maskz_min_pd(0xff, (__m512d)a.v[0], (__m512d)b.v[0])}};
}
VFPLAN_INLINE Lanes larger(Lanes a, Lanes b) {
    return {{(Native)_mm512_maskz_max_pd(0xff, (__m512d)a.v[0], (__m512d)b.v[0])}};
}
#else
VFPLAN_INLINE Lanes smaller(Lanes a, Lanes b) { return choose(a < b, a, b); }
VFPLAN_INLINE Lanes larger(Lanes a, Lanes b) { return choose(a > b, a, b); }
#endif

VFPLAN_INLINE Lanes root(Lanes a) {
#if VFPLAN_LANES == 8
    a.v[0] = (Native)_mm512_maskz_sqrt_pd(0xff, (__m512d)a.v[0]);
#elif VFPLAN_LANES == 4
    VFPLAN_EACH a.v[i] = (Native)_mm256_sqrt_pd((__m256d)a.v[i]);
#elif VFPLAN_X86
    VFPLAN_EACH a.v[i] = (Native)_mm_sqrt_pd((__m128d)a.v[i]);
#else
    VFPLAN_EACH for (int j = 0; j < VFPLAN_LANES; ++j) a.v[i][j] = std::sqrt(a.v[i][j]);
#endif
    return a;
}

VFPLAN_INLINE void store(Lanes a, double* p) {
    VFPLAN_EACH std::memcpy(p + VFPLAN_LANES * i, &a.v[i], sizeof(Native));
}

// 1/sqrt(a) to 1e-7 by correctly rounded float32 operations: nothing here depends on a processor's
// own approximation. One step of Newton's makes 2e-14 of it.
VFPLAN_INLINE void store_seeds(Lanes a, float* p) {
#if VFPLAN_LANES == 8
    const __m256 f = _mm512_maskz_cvtpd_ps(0xff, (__m512d)a.v[0]);
    _mm256_store_ps(p, _mm256_div_ps(_mm256_set1_ps(1), _mm256_sqrt_ps(f)));
#elif VFPLAN_LANES == 4
    const __m256 f = _mm256_set_m128(_mm256_cvtpd_ps((__m256d)a.v[1]),
                                     _mm256_cvtpd_ps((__m256d)a.v[0]));
    _mm256_store_ps(p, _mm256_div_ps(_mm256_set1_ps(1), _mm256_sqrt_ps(f)));
#elif VFPLAN_X86
    for (int i = 0; i < parts; i += 2) {
        const __m128 f = _mm_movelh_ps(_mm_cvtpd_ps((__m128d)a.v[i]),
                                       _mm_cvtpd_ps((__m128d)a.v[i + 1]));
        _mm_store_ps(p + 2 * i, _mm_div_ps(_mm_set1_ps(1), _mm_sqrt_ps(f)));
    }
#else
    VFPLAN_EACH for (int j = 0; j < VFPLAN_LANES; ++j) p[VFPLAN_LANES * i + j] =
        1.0f / std::sqrt(static_cast<float>(a.v[i][j]));
#endif
}
VFPLAN_INLINE Lanes load_seeds(const float* p) {
    Lanes a;
#if VFPLAN_LANES == 8
    a.v[0] = (Native)_mm512_maskz_cvtps_pd(0xff, _mm256_load_ps(p));
#elif VFPLAN_LANES == 4
    VFPLAN_EACH a.v[i] = (Native)_mm256_cvtps_pd(_mm_load_ps(p + 4 * i));
#elif VFPLAN_X86
    for (int i = 0; i < parts; i += 2) {
        const __m128 f = _mm_load_ps(p + 2 * i);
        a.v[i] = (Native)_mm_cvtps_pd(f);
        a.v[i + 1] = (Native)_mm_cvtps_pd(_mm_movehl_ps(f, f));
    }
#else
    VFPLAN_EACH for (int j = 0; j < VFPLAN_LANES; ++j) a.v[i][j] = p[VFPLAN_LANES * i + j];
#endif
    return a;
}

VFPLAN_INLINE unsigned bits(Mask m) {
    unsigned b = 0;
#if VFPLAN_LANES == 8
    b = _mm512_movepi64_mask((__m512i)m.v[0]);
#elif VFPLAN_LANES == 4
    VFPLAN_EACH b |= static_cast<unsigned>(_mm256_movemask_pd((__m256d)m.v[i])) << (4 * i);
#elif VFPLAN_X86
    VFPLAN_EACH b |= static_cast<unsigned>(_mm_movemask_pd((__m128d)m.v[i])) << (2 * i);
#else
    VFPLAN_EACH for (int j = 0; j < VFPLAN_LANES; ++j) b |=
        static_cast<unsigned>(m.v[i][j] & 1) << (VFPLAN_LANES * i + j);
#endif
    return b;
}

VFPLAN_INLINE double sum(Lanes a) {
    double v[8];
    store(a, v);
    return ((v[0] + v[4]) + (v[2] + v[6])) + ((v[1] + v[5]) + (v[3] + v[7]));
}

VFPLAN_INLINE double least(Lanes a) {
    double v[8];
    store(a, v);
    double m = v[0];
    for (int i = 1; i < 8; ++i) m = v[i] < m ? v[i] : m;
    return m;
}
