// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The most points of a cloud that lie close together.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "vfplan/cloud.hpp"

namespace vfplan {

/// How many points lie in each cell of a box around a cloud, or, once `spread`, in the cells
/// around it.
template <int D>
class Census {
  public:
    /// `side` of a cell [m]: more where the box would have many more cells than the cloud points.
    Census(const Cloud<D>& cloud, double side) : box_(cloud.box()), side_(side) {
        const double most = std::min(4194304.0, 8.0 * static_cast<double>(cloud.size()) + 1024);
        while (cells() > most) side_ *= 1.25;
        for (int k = 0; k < D; ++k) count_[k] = static_cast<std::size_t>(along(k)) + 1;
        held_.assign(static_cast<std::size_t>(cells()), 0);
        for (std::size_t i = 0; i < cloud.size(); ++i) ++held_[cell(cloud[i])];
    }

    /// Adds up, for each cell, what lies within `reach` of any place in it, and some around.
    void spread(double reach) {
        const auto around = static_cast<std::size_t>(std::ceil(reach / side_));
        std::vector<std::uint64_t> before;
        for (std::size_t k = 0, stride = 1; k < D; stride *= count_[k], ++k) {
            before.assign(count_[k] + 1, 0);
            for (std::size_t first = 0; first < held_.size(); ++first)
                if (first / stride % count_[k] == 0)
                    spread_row(&held_[first], stride, around, before);
        }
    }
    double most() const { return *std::max_element(held_.begin(), held_.end()); }

  private:
    double along(int k) const { return std::floor((box_.high[k] - box_.low[k]) / side_); }
    double cells() const {
        double product = 1;
        for (int k = 0; k < D; ++k) product *= along(k) + 1;
        return product;
    }
    std::size_t cell(const Vec<D>& p) const {
        std::size_t at = 0;
        for (int k = D; k-- > 0;) {
            const auto i = static_cast<std::size_t>((p[k] - box_.low[k]) / side_);
            at = at * count_[k] + std::min(i, count_[k] - 1);
        }
        return at;
    }
    static void spread_row(std::uint32_t* row, std::size_t stride, std::size_t around,
                           std::vector<std::uint64_t>& before) {
        const std::size_t n = before.size() - 1;
        for (std::size_t i = 0; i < n; ++i) before[i + 1] = before[i] + row[i * stride];
        for (std::size_t i = 0; i < n; ++i)
            row[i * stride] = static_cast<std::uint32_t>(before[std::min(i + around + 1, n)] -
                                                         before[i > around ? i - around : 0]);
    }

    Box<D> box_;
    double side_;
    std::size_t count_[D] = {};
    std::vector<std::uint32_t> held_;
};

/// The most points within `reach` of any place, or some more.
template <int D>
double crowd(const Cloud<D>& cloud, double reach) {
    constexpr double cells_a_reach = 4;
    Census<D> census(cloud, reach / cells_a_reach);
    census.spread(reach);
    return census.most();
}

}  // namespace vfplan
