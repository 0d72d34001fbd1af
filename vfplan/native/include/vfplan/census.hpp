// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// How much lies close together: the most points of a cloud, or boxes, around any one place.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "vfplan/cloud.hpp"

namespace vfplan {

/// The most of n boxes that lie within `reach` of any place, or some more: counted on a grid, by
/// what each box adds at its corners. `box(i)` gives them; `most`: of the grid's cells, whose side
/// grows until they are as few.
template <int D, class BoxOf>
double crowd(std::size_t n, const BoxOf& box, double reach, double most) {
    Box<D> all = box(0);
    for (std::size_t i = 1; i < n; ++i) {
        all.include(box(i).low);
        all.include(box(i).high);
    }
    double side = reach / 4;
    const auto count = [&](int k) { return std::floor((all.high.c[k] - all.low.c[k]) / side) + 1; };
    const auto cells = [&] {
        double product = 1;
        for (int k = 0; k < D; ++k) product *= count(k);
        return product;
    };
    while (cells() > most) side *= 1.25;
    std::size_t stride[D + 1] = {1};
    double last[D];
    for (int k = 0; k < D; ++k) {
        last[k] = count(k) - 1;
        stride[k + 1] = stride[k] * (static_cast<std::size_t>(last[k]) + 2);
    }
    const auto cell = [&](double place, int k) {
        const double at = std::clamp((place - all.low.c[k]) / side, 0.0, last[k]);
        return static_cast<std::size_t>(at) * stride[k];
    };
    std::vector<std::uint32_t> sum(stride[D]);  // what goes below 0 comes back
    for (std::size_t i = 0; i < n; ++i) {
        const Box<D> b = box(i);
        std::size_t ends[D][2];
        for (int k = 0; k < D; ++k) {
            ends[k][0] = cell(b.low.c[k] - reach, k);
            ends[k][1] = cell(b.high.c[k] + reach, k) + stride[k];
        }
        for (int corner = 0; corner < 1 << D; ++corner) {
            std::size_t at = 0;
            std::uint32_t sign = 1;
            for (int k = 0; k < D; ++k) {
                at += ends[k][corner >> k & 1];
                if (corner >> k & 1) sign = -sign;
            }
            sum[at] += sign;
        }
    }
    for (int k = 0; k < D; ++k)
        for (std::size_t i = stride[k]; i < sum.size(); ++i)
            if (i % stride[k + 1] >= stride[k]) sum[i] += sum[i - stride[k]];
    return *std::max_element(sum.begin(), sum.end());
}

/// The most points of a cloud within `reach` of any place, or some more.
template <int D>
double crowd(const Cloud<D>& cloud, double reach) {
    const auto box = [&](std::size_t i) { return Box<D>{cloud[i], cloud[i]}; };
    const double most = std::min(4194304.0, 8.0 * static_cast<double>(cloud.size()) + 1024);
    return crowd<D>(cloud.size(), box, reach, most);
}
/// The most of these boxes.
template <int D>
double crowd(const std::vector<Box<D>>& boxes, double reach) {
    const auto box = [&](std::size_t i) { return boxes[i]; };
    const double n = static_cast<double>(boxes.size());
    return crowd<D>(boxes.size(), box, reach, 8.0 * n + (D == 3 ? 1048576 : 65536));
}

}  // namespace vfplan
