// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// What a tick may still do, so that no tick is longer than a loop of 1 kHz can wait. The rules
// count what they look at and stop where the budget is spent (status `limit`), to go on in the next
// tick.
#pragma once

#include "vfplan/base/compiler.hpp"

namespace vfplan::inline v1 {

class WorkBudget {
  public:
    explicit WorkBudget(std::int64_t work = 0) noexcept { begin(work); }
    void begin(std::int64_t work) noexcept {
        done_ = total();
        begun_ = left_ = work;
    }
    /// A tick begins, and its first part. After `enough` in all parts no part begins anything more,
    /// and what is under way ends in a hurry; after `all` at once.
    void begin_tick(std::int64_t work, std::int64_t enough, std::int64_t all) noexcept {
        begin(work);
        hurry_ = done_ + enough;
        end_ = done_ + all;
    }
    template <class Integer>
    void spend(Integer work) noexcept {
        left_ -= static_cast<std::int64_t>(work);
    }
    bool is_fresh() const noexcept { return left_ == begun_; }
    bool is_spent() const noexcept { return left_ <= 0 || is_overdrawn(); }
    /// Whether the tick has done enough.
    bool is_overdrawn() const noexcept { return total() >= hurry_; }
    /// Whether the tick has done all that it may.
    bool is_over() const noexcept { return total() >= end_; }
    /// What was spent since it was made.
    std::int64_t total() const noexcept { return done_ + begun_ - left_; }

  private:
    static constexpr std::int64_t never = std::numeric_limits<std::int64_t>::max();
    std::int64_t left_ = 0, begun_ = 0, done_ = 0, hurry_ = never, end_ = never;
};

}  // namespace vfplan::inline v1
