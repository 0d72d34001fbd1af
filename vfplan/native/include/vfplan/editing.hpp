// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The points of an engine that is edited, as the editor's thread knows them: each keeps its number
// for good, whatever is taken away before it.
#pragma once

#include <string>

#include "vfplan/changing.hpp"
#include "vfplan/edited.hpp"
#include "vfplan/parameters.hpp"
#include "vfplan/work.hpp"

namespace vfplan::detail {

class Points {
  public:
    /// Fewer are made anew at each edit: measured in docs/moving.md.
    static constexpr std::size_t worth_editing = 500;

    Points(const double* xyz, std::size_t n) : xyz_(xyz, xyz + 3 * n), local_(n), left_(n) {
        made();
    }

    std::size_t size() const noexcept { return left_; }
    /// x y z of those that are left, in the order of their numbers.
    std::vector<double> left() const {
        std::vector<double> all;
        all.reserve(3 * left_);
        for (std::size_t i = 0; i < local_.size(); ++i)
            if (local_[i] != gone) all.insert(all.end(), &xyz_[3 * i], &xyz_[3 * i] + 3);
        return all;
    }
    /// An engine was made of those: it counts from 0.
    void made() noexcept {
        std::size_t next = 0;
        for (std::size_t& local : local_)
            if (local != gone) local = next++;
        base_ = next_ = next;
        behind_ = false;
    }
    /// No engine has the last edit.
    void missed() noexcept { behind_ = true; }
    /// Whether the engine made last takes m more as it is.
    bool fits(std::size_t m) const noexcept {
        return !behind_ && base_ >= worth_editing && next_ - base_ + m <= Edited<3>::room(base_);
    }

    /// The same for that engine. Throws std::invalid_argument, and changes nothing, for a number
    /// that is no point's or no longer, for coordinates out of range, and where none would be left.
    std::vector<Change> edit(const std::uint32_t* remove, std::size_t n, const double* add,
                             std::size_t m, const Parameters& p) {
        for (std::size_t i = 0; i < 3 * m; ++i)
            if (!(std::abs(add[i]) <= largest_coordinate))
                reject("points must be finite and within 1e6 m");
        check_resolved(p, add, m);
        if ((next_ - base_ + m) / a_look > (next_ - base_) / a_look) check_crowd(add, m, p);
        std::vector<Change> all;
        all.reserve(n + m);
        for (std::size_t i = 0; i < n; ++i) {
            const bool there = remove[i] < local_.size() && local_[remove[i]] != gone;
            if (!there || left_ + m <= n) {
                for (; i-- > 0; all.pop_back()) local_[remove[i]] = all.back().id;
                reject(there ? "a cloud needs at least one point"
                             : "remove: each a point that is there, once");
            }
            all.push_back({Change::remove, nullptr, std::exchange(local_[remove[i]], gone), {}});
        }
        for (std::size_t i = 0; i < m; ++i) {
            all.push_back(
                {Change::add, nullptr, 0, {{add[3 * i], add[3 * i + 1], add[3 * i + 2]}}});
            local_.push_back(next_++);
        }
        xyz_.insert(xyz_.end(), add, add + 3 * m);
        left_ = left_ + m - n;
        return all;
    }

  private:
    static constexpr std::size_t gone = ~std::size_t{0};
    static constexpr std::size_t a_look = 1024;  // points: in one place less than most_tick_work

    /// Refuses points that came, and would, so close together that a tick takes too long.
    void check_crowd(const double* add, std::size_t m, const Parameters& p) const {
        std::vector<double> came(add, add + 3 * m);
        for (std::size_t i = local_.size() - (next_ - base_); i < local_.size(); ++i)
            if (local_[i] != gone) came.insert(came.end(), &xyz_[3 * i], &xyz_[3 * i] + 3);
        if (!(tick_work(came.data(), came.size() / 3, p) <= most_tick_work))
            reject("add: so many points in one place that a tick would take longer than 0.3 ms");
    }

    std::vector<double> xyz_;
    std::vector<std::size_t> local_;  // each point's number in the engine made last
    std::size_t left_;
    std::size_t base_ = 0, next_ = 0;  // of that engine: points it was made of, next number
    bool behind_ = false;
};

}  // namespace vfplan::detail
