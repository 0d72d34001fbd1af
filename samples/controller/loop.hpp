// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The loop's clock, its log, and what it says of itself. All memory is taken before the first tick.
#pragma once

#include <sys/mman.h>
#include <time.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <functional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "vfplan/parameters.hpp"

namespace controller {

/// A file that is not what it should be; names it and the line.
struct FileError : std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// A log that is there already or cannot be written; names it.
struct OutputError : std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// What an error says. Where a place is named before it, the library's name is left out.
inline std::string reason(const std::exception& error) {
    const std::string words = error.what();
    const std::string name = "vfplan: ";
    return words.starts_with(name) ? words.substr(name.size()) : words;
}

/// The number of the signal that asks the loop to stop; 0 while there is none.
inline volatile std::sig_atomic_t stop_signal = 0;

/// From now on these signals end the loop and not the program, so that the log is written. A signal
/// that the program was started to ignore stays ignored.
inline void catch_stop_signals() {
    for (const int number : {SIGINT, SIGTERM, SIGHUP}) {
        const auto before = std::signal(number, [](int caught) { stop_signal = caught; });
        if (before == SIG_IGN) std::signal(number, SIG_IGN);
    }
}

/// Absolute deadlines, one period apart; in simulated time it never waits.
class Clock {
  public:
    Clock(double period, bool simulated) : period_ns_(std::int64_t(period * 1e9)) {
        simulated_ = simulated;
        clock_gettime(CLOCK_MONOTONIC, &next_);
    }
    /// Waits for the next tick; true when the one before ended too late for it.
    bool wait() {
        if (simulated_) return false;
        next_.tv_nsec += period_ns_;
        for (; next_.tv_nsec >= 1'000'000'000; next_.tv_nsec -= 1'000'000'000) ++next_.tv_sec;
        timespec now{};
        clock_gettime(CLOCK_MONOTONIC, &now);
        const bool late = now.tv_sec > next_.tv_sec ||
                          (now.tv_sec == next_.tv_sec && now.tv_nsec > next_.tv_nsec);
        if (late)
            next_ = now;  // go on from here: no burst to catch up
        else
            clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &next_, nullptr);
        return late;
    }

  private:
    std::int64_t period_ns_;
    bool simulated_;
    timespec next_{};
};

/// Time and answer of every tick. Its file is claimed before the loop and written after it; one
/// that is not written is taken away.
class Log {
  public:
    struct Row {
        double t;
        vfplan::Vec3 hip;
        vfplan::Step step;      // its force is the one that was commanded
        vfplan::Vec3 rendered;  // the engine's force, before a governor
        double step_us;
        std::uint64_t poses = 0, changes = 0;  // that the tick knew of
    };

    /// Without a path there is no file.
    Log(std::string path, std::size_t ticks, bool governed)
        : path_(std::move(path)), governed_(governed) {
        rows_.reserve(ticks);
        if (path_.empty()) return;
        file_ = std::fopen(path_.c_str(), "wx");
        if (file_ != nullptr) return;
        if (errno == EEXIST)
            throw OutputError(path_ + ": the log is there already. Give --log another name.");
        throw OutputError(path_ + ": the log cannot be written: " + std::strerror(errno) +
                          ". Give --log a place that you may write to.");
    }
    Log(const Log&) = delete;
    Log& operator=(const Log&) = delete;
    ~Log() {
        if (file_ == nullptr) return;
        std::fclose(file_);
        std::remove(path_.c_str());
    }
    /// Of changes the events that they are; for a fixture that moves, is exchanged or edited.
    std::function<std::size_t(std::uint64_t)> begun;
    void add(const Row& row) { rows_.push_back(row); }

    /// A session: t, x, y, z as `vfplan replay` reads them, and what was answered, to the last bit.
    void write() {
        std::FILE* const file = std::exchange(file_, nullptr);
        if (file == nullptr) return;
        std::fputs("t,x,y,z,proxy_x,proxy_y,proxy_z,force_x,force_y,force_z,state,status", file);
        if (governed_) std::fputs(",engine_x,engine_y,engine_z", file);
        std::fputs(begun ? ",poses,events\n" : "\n", file);
        for (const Row& r : rows_) {
            std::fprintf(file, "%.17g", r.t);
            for (const vfplan::Vec3* v : {&r.hip, &r.step.proxy, &r.step.force})
                for (int k = 0; k < 3; ++k) std::fprintf(file, ",%.17g", (*v)[k]);
            std::fprintf(file, ",%d,%u", int(r.step.state), unsigned(r.step.status));
            for (int k = 0; governed_ && k < 3; ++k) std::fprintf(file, ",%.17g", r.rendered[k]);
            if (begun) std::fprintf(file, ",%zu,%zu", std::size_t(r.poses), begun(r.changes));
            std::fputc('\n', file);
        }
        const bool bad = std::ferror(file) != 0;
        if (std::fclose(file) != 0 || bad) {
            std::remove(path_.c_str());
            throw OutputError(path_ +
                              ": the log could not be written. See that the disk has room for it.");
        }
    }

    /// Ticks that had no pose young enough.
    [[nodiscard]] std::size_t stale() const {
        return std::size_t(std::count_if(rows_.begin(), rows_.end(), [](const Row& r) {
            return (r.step.status & vfplan::Status::stale_pose) != 0;
        }));
    }

    void report(std::size_t missed) const {
        std::vector<double> us;
        std::size_t contact = 0;
        double strongest = 0, jerk = 0;
        vfplan::Vec3 before{};
        for (const Row& r : rows_) {
            us.push_back(r.step_us);
            contact += r.step.state >= vfplan::State::in_contact;
            strongest = std::max(strongest, norm(r.step.force));
            jerk = std::max(jerk, norm(r.step.force - before));
            before = r.step.force;
        }
        std::sort(us.begin(), us.end());
        const auto at = [&us](double share) {
            return us[std::min(us.size() - 1, std::size_t(share * double(us.size())))];
        };
        std::printf("ticks %zu, in contact %zu, force up to %.3f N, in steps of up to %.3f N\n",
                    us.size(), contact, strongest, jerk);
        std::printf("step [us]: p50 %.3f  p99 %.3f  p99.9 %.3f  max %.3f\n", at(0.5), at(0.99),
                    at(0.999), us.back());
        std::printf("missed deadlines: %zu of %zu\n", missed, us.size());
    }

  private:
    std::string path_;
    bool governed_;
    std::FILE* file_ = nullptr;
    std::vector<Row> rows_;
};

}  // namespace controller
