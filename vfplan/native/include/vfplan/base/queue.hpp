// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// From one thread to one other, without locks.
#pragma once

#include <atomic>
#include <bit>

#include "vfplan/base/compiler.hpp"

namespace vfplan::inline v1 {

/// A queue from one thread to one other. Neither of them locks, waits or allocates.
template <class T>
class SpscQueue {
  public:
    /// Holds at least `capacity` items: the number is rounded up to a power of two. Allocates.
    explicit SpscQueue(std::size_t capacity = 1) : items_(std::bit_ceil(capacity)) {}
    /// The same later, before anything was given; for the thread that gives.
    void reserve(std::size_t capacity) {
        if (items_.size() < capacity) items_.resize(std::bit_ceil(capacity));
    }
    std::size_t bytes() const noexcept { return items_.capacity() * sizeof(T); }

    /// How many more items fit; for the thread that gives.
    std::size_t free_slots() const noexcept {
        return items_.size() - std::size_t(head_.load(std::memory_order_relaxed) -
                                           tail_.load(std::memory_order_acquire));
    }
    /// Gives n items, which the other thread sees all at once; false where they do not all fit.
    bool push(const T* items, std::size_t n) noexcept {
        if (free_slots() < n) return false;
        const std::uint64_t at = head_.load(std::memory_order_relaxed);
        for (std::size_t i = 0; i < n; ++i) items_[(at + i) & (items_.size() - 1)] = items[i];
        head_.store(at + n, std::memory_order_release);
        return true;
    }
    bool push(const T& item) noexcept { return push(&item, 1); }
    /// How many items the other thread has not taken yet; for the thread that gives.
    std::size_t size() const noexcept { return items_.size() - free_slots(); }
    /// The oldest item, or null; for the thread that takes.
    const T* front() const noexcept {
        const std::uint64_t at = tail_.load(std::memory_order_relaxed);
        if (at == head_.load(std::memory_order_acquire)) return nullptr;
        return &items_[at & (items_.size() - 1)];
    }
    /// Whether another one waits behind it; for the thread that takes.
    bool holds_more() const noexcept {
        return head_.load(std::memory_order_acquire) - tail_.load(std::memory_order_relaxed) > 1;
    }
    /// Drops the item that `front` gave; for the thread that takes.
    void pop() noexcept {
        tail_.store(tail_.load(std::memory_order_relaxed) + 1, std::memory_order_release);
    }

  private:
    std::vector<T> items_;
    alignas(64) std::atomic<std::uint64_t> head_{0};
    alignas(64) std::atomic<std::uint64_t> tail_{0};
};

}  // namespace vfplan::inline v1
