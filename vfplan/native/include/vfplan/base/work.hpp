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
    void begin(std::int64_t work) noexcept {
        done_ = total();
        begun_ = left_ = work;
    }
    template <class Integer>
    void spend(Integer work) noexcept {
        left_ -= static_cast<std::int64_t>(work);
    }
    bool is_spent() const noexcept { return left_ <= 0; }
    /// What has begun before it was spent ends here at last.
    bool is_overdrawn() const noexcept { return left_ <= -begun_ / 2; }
    /// What was spent since it was made.
    std::int64_t total() const noexcept { return done_ + begun_ - left_; }

  private:
    std::int64_t left_ = 0, begun_ = 0, done_ = 0;
};

}  // namespace vfplan::inline v1
