// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// What happens to the fixture while the loop runs: a tracker's poses, exchanges and edits, as the
// files of docs/replay.md have them. All that can be made beforehand is; what is left is handed to
// the loop, at its tick, or in real time by a thread of its own.
#pragma once

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <fstream>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "loop.hpp"
#include "vfplan/controller.hpp"
#include "vfplan/engine.hpp"

namespace controller {

struct Posed {
    double time;  // when the tracker looked [s]
    vfplan::Pose pose;
    double arrived;  // when the loop has it [s]
};

struct Event {
    std::size_t tick = 0;
    std::string what, where;  // exchange, edit or remake; file and line
    std::filesystem::path bundle;
    std::vector<std::uint32_t> remove;
    std::vector<double> add;
    std::optional<vfplan::Controller> made;  // of an exchange

    [[nodiscard]] bool exchanges() const { return what == "exchange"; }
};

template <class T>
T number(const std::string& text) {
    T value{};
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc{} || end != text.data() + text.size() || !std::isfinite(double(value)))
        throw FileError("'" + text + "' is no number of the kind that is needed. Mend the line.");
    return value;
}

inline std::string trimmed(const std::string& text) {
    const std::size_t first = std::min(text.find_first_not_of(" \t\r"), text.size());
    return text.substr(first, text.find_last_not_of(" \t\r") + 1 - first);
}

/// A coordinate or time, as `vfplan replay` reads one: blanks around it, and a sign.
inline double real(const std::string& text) {
    const std::string plain = trimmed(text);
    const bool plus = plain.starts_with('+') && !plain.starts_with("+-");
    return number<double>(plain.substr(plus));
}

inline std::vector<std::string> split(const std::string& text) {
    std::vector<std::string> fields(1);
    for (const char c : text)
        if (c == ',')
            fields.emplace_back();
        else
            fields.back() += c;
    return fields;
}

/// `use(fields, place)` of each line after the first, which is given to `head`.
template <class H, class F>
void each_line(const std::string& path, H&& head, F&& use) {
    std::ifstream file(path);
    std::string text;
    if (!std::getline(file, text)) throw FileError(path + ": cannot be read. Check its name.");
    for (int line = 1; file; ++line, std::getline(file, text)) {
        const std::string place = path + ", line " + std::to_string(line);
        text = trimmed(text);
        try {
            if (line == 1)
                head(text);
            else if (!text.empty())
                use(split(text), place);
        } catch (const FileError& error) {
            throw FileError(place + ": " + error.what());
        }
    }
}

/// The column of each of the `wanted` names, and last how many columns there are.
inline std::vector<std::size_t> columns(std::string head, std::vector<std::string> wanted) {
    if (head.starts_with("\xef\xbb\xbf")) head.erase(0, 3);
    for (char& c : head) c = c >= 'A' && c <= 'Z' ? char(c - 'A' + 'a') : c;
    std::vector<std::string> names;
    for (const std::string& name : split(head)) names.push_back(trimmed(name));
    if (std::count(names.begin(), names.end(), "arrived") == 0) wanted.pop_back();
    std::vector<std::size_t> at;
    for (const std::string& name : wanted) {
        if (std::count(names.begin(), names.end(), name) != 1)
            throw FileError("a header names " + name +
                            " not at all or twice. Name t,x,y,z,qw,qx,qy,qz once each.");
        at.push_back(std::size_t(std::find(names.begin(), names.end(), name) - names.begin()));
    }
    if (at.size() == 8) at.push_back(at[0]);  // arrived when it was taken
    at.push_back(names.size());
    return at;
}

/// By the names in the header, `arrived` where it is there.
inline std::vector<Posed> read_poses(const std::string& path) {
    std::vector<Posed> poses;
    std::vector<std::size_t> at;
    const auto head = [&](const std::string& text) {
        at = columns(text, {"t", "x", "y", "z", "qw", "qx", "qy", "qz", "arrived"});
    };
    each_line(path, head, [&](const auto& fields, const auto&) {
        if (fields.size() != at[9])
            throw FileError(std::to_string(fields.size()) + " fields; " + std::to_string(at[9]) +
                            " wanted. Give one for each column of the header.");
        std::vector<double> all, v;
        for (const std::string& field : fields) all.push_back(real(field));
        for (int k = 0; k < 9; ++k) v.push_back(all[at[std::size_t(k)]]);
        const double size = v[4] * v[4] + v[5] * v[5] + v[6] * v[6] + v[7] * v[7];
        if (!(std::abs(std::sqrt(size) - 1) < 1e-3))
            throw FileError("no unit quaternion. Scale qw,qx,qy,qz to length 1.");
        for (int k = 1; k < 4; ++k)
            if (!(std::abs(v[std::size_t(k)]) <= vfplan::largest_coordinate))
                throw FileError("a place beyond 1e6 m. Give metres.");
        if (!poses.empty() && v[8] < poses.back().arrived)
            throw FileError("not in order. Sort the poses by the time at which they arrived.");
        poses.push_back({v[0], {{{v[1], v[2], v[3]}}, v[4], {{v[5], v[6], v[7]}}}, v[8]});
    });
    if (poses.empty()) throw FileError(path + ": holds no pose. Give one at least.");
    return poses;
}

inline std::vector<Event> read_events(const std::string& path) {
    std::vector<Event> events;
    const auto head = [](const std::string& text) {
        if (text != "tick,what,x,y,z")
            throw FileError("a first line of another form. Begin the file with tick,what,x,y,z.");
    };
    each_line(path, head, [&](const auto& fields, const auto& place) {
        const std::size_t n = fields.size(), tick = number<std::size_t>(fields[0]);
        const std::string what = n > 1 ? fields[1] : "";
        Event* last = events.empty() ? nullptr : &events.back();
        if (last && tick < last->tick) throw FileError("not in order. Sort the events by tick.");
        const bool goes_on = last && last->what == "edit" && tick == last->tick;
        if (what == "remove" && n == 3 && goes_on && last->add.empty())
            last->remove.push_back(number<std::uint32_t>(fields[2]));
        else if (what == "add" && n == 5 && goes_on)
            for (std::size_t i = 2; i < 5; ++i) last->add.push_back(real(fields[i]));
        else if ((what == "edit" || what == "remake") ? n == 2 : what == "exchange" && n == 3)
            events.push_back({tick, what, place, {}, {}, {}, {}});
        else
            throw FileError(
                "no event, or not the next of an edit. docs/replay.md says how events are "
                "written.");
        if (what == "exchange")
            events.back().bundle = std::filesystem::path(path).parent_path() / fields[2];
    });
    return events;
}

/// Hands an event to a controller, with the one that an exchange brings; what cannot be done is
/// said with the event's line.
inline void hand_over(const Event& event, vfplan::Controller& controller,
                      vfplan::Controller* other) try {
    const std::size_t n = event.remove.size(), m = event.add.size() / 3;
    bool done = false;
    if (event.exchanges())
        done = controller.exchange(std::move(*other));
    else if (event.what == "edit")
        done = controller.edit(event.remove.data(), n, event.add.data(), m);
    else
        done = controller.remake();
    if (!done) throw FileError("too much waits for the loop. Put more ticks between the events.");
} catch (const std::exception& error) {
    throw FileError(event.where + ": " + reason(error));
}

class Changing {
  public:
    Changing(vfplan::Controller& controller, std::vector<Posed> poses, std::vector<Event> events)
        : controller_(controller),
          region_(controller.region()),
          frame_(controller.frame()),
          poses_(std::move(poses)),
          events_(std::move(events)) {
        before_.reserve(events_.size());
    }

    /// In simulated time: all that tick k, at t, begins with.
    void due(std::size_t k, double t) noexcept try {
        if (failed_) return;
        for (; posed_ < poses_.size() && poses_[posed_].arrived <= t; ++posed_) {
            if (frame_->room() == 0) controller_.take_poses(t);
            if (frame_->room() == 0) break;  // it waits, as in real time
            controller_.pose(poses_[posed_].time, poses_[posed_].pose);
        }
        while (before_.size() < events_.size() && events_[before_.size()].tick <= k) next();
    } catch (...) {
        failed_ = std::current_exception();
    }
    /// In real time: the same by another thread, each at its time, until `finish`. After what it
    /// cannot do nothing more is handed over, and the loop goes on.
    void start(double period) {
        thread_ = std::jthread([this, period](const std::stop_token& over) {
            try {
                serve(over, period);
            } catch (...) {
                failed_ = std::current_exception();
            }
        });
    }
    void finish() {
        if (thread_.joinable()) thread_.request_stop(), thread_.join();
    }
    /// Throws what could not be done.
    void check() const {
        if (failed_) std::rethrow_exception(failed_);
    }

    /// What a log needs to be replayed: poses that the tick knew of, changes that it had taken up.
    [[nodiscard]] std::uint64_t seen() const noexcept { return frame_ ? frame_->seen() : 0; }
    [[nodiscard]] std::uint64_t taken() const noexcept {
        return region_ ? region_->changes_applied() : 0;
    }
    /// Of the changes, the events that had begun.
    [[nodiscard]] std::size_t begun(std::uint64_t taken) const {
        return std::size_t(std::lower_bound(before_.begin(), before_.end(), taken) -
                           before_.begin());
    }

    /// What became of the files in the end.
    void report(std::size_t stale) const {
        if (frame_)
            std::printf("poses: %zu of %zu known, %zu refused; %zu stale tick%s\n",
                        std::size_t(seen()), poses_.size(), std::size_t(frame_->refused()), stale,
                        stale == 1 ? "" : "s");
        if (!events_.empty())
            std::printf("events: %zu of %zu begun\n", begun(taken()), events_.size());
    }

  private:
    void next() {
        Event& event = events_[before_.size()];
        before_.push_back(region_->changes_applied() + region_->changes_pending());
        hand_over(event, controller_, event.exchanges() ? &*event.made : nullptr);
    }

    void serve(const std::stop_token& over, double period) {
        using clock = std::chrono::steady_clock;
        const auto began = clock::now();
        const auto wait = [&](double t, auto&& room) {
            const auto early = [&] {
                return std::chrono::duration<double>(clock::now() - began).count() < t;
            };
            while (!over.stop_requested() && (early() || !room()))
                std::this_thread::sleep_for(std::chrono::microseconds(200));
            return !over.stop_requested();
        };
        while (posed_ < poses_.size() || before_.size() < events_.size()) {
            const Posed* pose = posed_ < poses_.size() ? &poses_[posed_] : nullptr;
            const Event* event =
                before_.size() < events_.size() ? &events_[before_.size()] : nullptr;
            if (pose && !(event && double(event->tick) * period < pose->arrived)) {
                if (!wait(pose->arrived, [&] { return frame_->room() > 0; })) return;
                controller_.pose(pose->time, pose->pose);
                ++posed_;
            } else {  // the loop has all of the one before: what a tick takes up is then the file's
                const auto idle = [&] { return region_->changes_pending() == 0; };
                if (!wait(double(event->tick) * period, idle)) return;
                next();
            }
        }
    }

    vfplan::Controller& controller_;
    const vfplan::Engine* region_;      // null for a guide, which no event changes
    const vfplan::MovingFrame* frame_;  // null for a fixture that stays
    std::vector<Posed> poses_;
    std::vector<Event> events_;
    std::size_t posed_ = 0;
    std::vector<std::uint64_t> before_;  // changes handed over before each event
    std::exception_ptr failed_;
    std::jthread thread_;
};

}  // namespace controller
