// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// A 1 kHz controller on a simulated arm. What a real one does differently stands in
// docs/controller.md: where the tip's position comes from, and where the force goes.
#include <algorithm>
#include <charconv>
#include <iostream>
#include <memory>
#include <optional>

#include "arm.hpp"
#include "changing.hpp"
#include "hand.hpp"
#include "loop.hpp"
#include "options.hpp"
#include "vfplan/bundle/engine.hpp"
#include "vfplan/controller.hpp"
#include "vfplan/telemetry.hpp"

namespace {

using namespace controller;

/// What sends the ticks to a viewer, if they are to be sent.
std::unique_ptr<vfplan::Telemetry> telemetry(const std::string& value) {
    if (value.empty()) return nullptr;
    const std::size_t colon = std::min(value.rfind(':'), value.size());
    const char* const end = value.data() + value.size();
    const char* const digits = std::min(value.data() + colon + 1, end);
    std::uint16_t port = 0;
    const auto [stop, error] = std::from_chars(digits, end, port);
    if (error != std::errc{} || stop != end)
        throw UsageError("--telemetry " + value +
                         " is no address. Give HOST:PORT, as 127.0.0.1:5005.");
    try {
        return std::make_unique<vfplan::Telemetry>(port, value.substr(0, colon));
    } catch (const std::invalid_argument& wrong) {
        throw UsageError("--telemetry " + value + ": " + reason(wrong));
    }
}

/// How the loop ended.
struct Ending {
    std::size_t missed = 0;  // deadlines
    std::size_t tick = 0;    // in which the force began to fade
    unsigned stopping = 0;   // why, as Command::stopping says it; 0 after all ticks
    int signal = 0;          // that asked for it
};

/// The loop: read the tip, render, show the tick, hand the force to the arm. Nothing in it
/// allocates or waits. What stops it lets the force fade first. The log holds the ticks until then,
/// for a replay knows of no fading.
Ending run(vfplan::Controller& controller, Changing& changing, const Hand& hand, Form& form,
           std::size_t ticks, bool simulated_time, vfplan::Telemetry* sender, Log& log) {
    Tip tip{hand.start(), {}};
    controller.reset(tip.position);
    Ending ending;
    if (!simulated_time) changing.start(period);
    Clock clock(period, simulated_time);
    for (std::size_t k = 0; k < ticks; ++k) {
        ending.missed += clock.wait();
        const double t = double(k) * period;
        if (simulated_time) changing.due(k, t);
        const auto before = std::chrono::steady_clock::now();
        const vfplan::Command out = controller.step(tip.position, t);
        const vfplan::Step shown{out.proxy, out.normal, out.force, out.state, out.status};
        if (sender != nullptr) sender->publish(t, tip.position, shown);
        const std::chrono::duration<double, std::micro> took =
            std::chrono::steady_clock::now() - before;
        if (!out.stopping) {
            log.add({t, tip.position, shown, out.rendered, took.count(), changing.seen(),
                     changing.taken()});
            ending.tick = k + 1;
        }
        ending.stopping = out.stopping;
        if (out.stop) break;
        ending.signal = stop_signal;
        if (ending.signal != 0) controller.request_stop();
        std::visit([&](auto& arm) { arm.tick(tip, hand.force(tip, t), out.force, period); }, form);
    }
    changing.finish();
    return ending;
}

/// The fixture that meets the demands. Without keys it is undamaged, which says nothing about who
/// made it: anybody who can write the file can seal another one.
vfplan::bundle::Fixture load(const Options& o, const std::string& path) {
    vfplan::bundle::Fixture fixture = vfplan::load(path, o.demand);
    if (o.demand.keys.empty())
        std::fprintf(stderr,
                     "controller: warning: %s is loaded without a signature: it is undamaged, but "
                     "anybody may have made it, for any patient. Sign it with `vfplan sign`.\n",
                     path.c_str());
    return fixture;
}

/// The controller of a fixture; limits that are not passive are the option's mistake.
vfplan::Controller govern(const vfplan::bundle::Fixture& fixture, const Options& o,
                          const vfplan::ControllerSettings& settings) try {
    return vfplan::Controller(fixture, o.demand, settings);
} catch (const vfplan::OutOfRange& error) {
    if (!error.name.starts_with("force_")) throw;
    char option[64];
    std::snprintf(option, sizeof option, "--governor %g,%g", settings.governor.force_step,
                  settings.governor.force_max);
    throw UsageError(option + (": " + reason(error)));
}

/// Makes what the events exchange, each by its own best rule where the first one's is exact;
/// returns the stiffness of the stiffest [N/m]. Every event is tried on another controller first:
/// what it cannot do is found before the loop.
double make_exchanged(std::vector<Event>& events, const Options& o,
                      const vfplan::bundle::Fixture& fixture, vfplan::ControllerSettings settings) {
    const vfplan::Rule rule = *settings.rule;
    settings.moving.reset();
    settings.governor.force_step = 2 * settings.governor.force_max;  // any K: `govern` checks it
    vfplan::ControllerSettings any = settings;
    any.any_tick_time = true;
    vfplan::Controller trial(fixture, o.demand, any);
    double stiffness = 0;
    vfplan::Rule now = rule;
    for (Event& event : events) {
        while (trial.region()->changes_pending() > 0) trial.step({});
        if (!event.exchanges()) {
            if (now == vfplan::Rule::exact)
                throw FileError(event.where +
                                ": edit: rule 'exact' renders no points, which "
                                "could be edited. Give --rule robust.");
            hand_over(event, trial, nullptr);
            continue;
        }
        const auto other = load(o, event.bundle.string());
        if (other.guidance)
            throw FileError(event.where + ": no forbidden region. Exchange it for one that is.");
        now = rule == vfplan::Rule::exact ? vfplan::bundle::best_rule(other) : rule;
        settings.rule = any.rule = now;
        event.made.emplace(other, o.demand, settings);
        stiffness = std::max(stiffness, event.made->stiffness());
        vfplan::Controller another(other, o.demand, any);
        hand_over(event, trial, &another);
    }
    return stiffness;
}

int control(const Options& o) {
    // Load, check, copy to plain arrays, close: no file meets the loop.
    const vfplan::bundle::Fixture fixture = load(o, o.fixture);
    auto poses = o.poses.empty() ? std::vector<Posed>{} : read_poses(o.poses);
    auto events = o.events.empty() ? std::vector<Event>{} : read_events(o.events);
    const bool changes = !poses.empty() || !o.events.empty();
    if (changes && fixture.guidance)
        throw FileError(o.fixture +
                        ": poses and events are for forbidden regions, and this fixture guides. "
                        "Leave --poses and --events out.");
    if (changes && !o.telemetry.empty())
        std::fprintf(stderr,
                     "controller: warning: `vfplan live` draws the fixture as it was first. Do not "
                     "judge a contact by its picture.\n");
    if (o.rule == vfplan::Rule::exact && fixture.mesh.empty() && fixture.pieces_of(false).empty())
        throw FileError(
            o.fixture +
            ": --rule exact needs lines and arcs, or triangles, and it has none. Plan it "
            "with --arcs, or give --rule robust, which takes its points.");
    vfplan::Parameters p = vfplan::bundle::parameters(fixture, o.rule);
    vfplan::ControllerSettings settings = o.settings;
    settings.rule = p.rule;
    settings.any_tick_time = o.simulated_time;
    if (!poses.empty() && !settings.moving) settings.moving.emplace();
    if (!std::all_of(events.begin(), events.end(), [](auto& e) { return e.exchanges(); }))
        settings.search = vfplan::Search::editable;
    if (!events.empty()) settings.max_stiffness = make_exchanged(events, o, fixture, settings);
    vfplan::Controller controller = govern(fixture, o, settings);
    Changing changing(controller, std::move(poses), std::move(events));
    const Hand hand(fixture.points, 4 * p.R(), p.ignore_axis, o.seconds);
    const auto ticks = std::size_t(o.seconds / period + 0.5);
    const auto sender = telemetry(o.telemetry);
    catch_stop_signals();
    Log log(o.log, ticks, o.is_governed);
    if (changes) log.begun = [&](std::uint64_t taken) { return changing.begun(taken); };
    Form form = o.form;
    // Without page faults later. The system refuses it to a user without the right to.
    mlockall(MCL_CURRENT | MCL_FUTURE);
    const Ending ending =
        run(controller, changing, hand, form, ticks, o.simulated_time, sender.get(), log);
    munlockall();
    log.write();
    log.report(ending.missed);
    changing.report(log.stale());
    if (sender)
        std::printf("telemetry: %llu ticks dropped, %llu datagrams not taken by the system\n",
                    static_cast<unsigned long long>(sender->dropped()),
                    static_cast<unsigned long long>(sender->unsent()));
    if (o.is_governed)
        std::printf("governor: gave up to %.4f mJ of %.4f mJ stored\n",
                    1e3 * controller.governor().energy_given(),
                    1e3 * controller.governor().energy_stored());
    changing.check();
    if (ending.signal != 0) {
        std::cerr << o.fixture << ": signal " << ending.signal
                  << " stopped the loop. Start it again for all of its ticks.\n";
        return 128 + ending.signal;
    }
    if (ending.stopping != 0) {
        std::cerr << o.fixture << ": the loop stopped in tick " << ending.tick
                  << ", because the tip's place in the fixture was not finite, beyond 1e6 m, or "
                     "too far from the one before. Check the poses and where the tip starts.\n";
        return 1;
    }
    return 0;
}

}  // namespace

int main(int argc, char** argv) {
    const std::vector<std::string> words(argv + 1, argv + argc);
    if (std::find(words.begin(), words.end(), "--help") != words.end()) {
        std::cout << usage;
        return 0;
    }
    Options options;
    try {
        options = parse(words);
        return control(options);
    } catch (const UsageError& error) {
        std::cerr << error.what() << " `controller --help` lists all options.\n";
        return 2;
    } catch (const vfplan::bundle::BundleError& error) {
        std::cerr << error.what() << "\n";  // names the file
        return error.kind() == "InputError" ? 3 : 4;
    } catch (const OutputError& error) {
        std::cerr << error.what() << "\n";
        return 2;
    } catch (const FileError& error) {
        std::cerr << error.what() << "\n";
        return 3;
    } catch (const std::exception& error) {
        std::cerr << options.fixture << ": " << reason(error) << "\n";
        return 3;
    }
}
