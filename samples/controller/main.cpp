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
#ifdef WITH_SIGNATURES
#include "vfplan/bundle/trust.hpp"
#endif
#include "vfplan/governor.hpp"
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

/// A governor that may let go of the fixture's whole spring. Limits that are not passive with this
/// stiffness and the arm's mass are refused here.
std::optional<vfplan::Governor> governor(const Options& o, double stiffness) {
    if (!o.governor) return std::nullopt;
    vfplan::GovernorLimits limits = *o.governor;
    limits.stiffness = stiffness;
    char option[64];
    std::snprintf(option, sizeof option, "--governor %g,%g", limits.force_step, limits.force_max);
    return as_option(option, [&] { return vfplan::Governor(limits); });
}

/// How the loop ended.
struct Ending {
    std::size_t missed = 0;               // deadlines
    std::optional<std::size_t> bad_tick;  // whose position could not be rendered
    int signal = 0;                       // that ended it
};

/// The loop: read the tip, render, govern, show the tick, hand the force to the arm. Nothing in
/// it allocates or waits. A signal or a bad position ends it after its tick.
///
/// The arm is simulated, so the loop goes on whatever else `status` says, and the log shows it. The
/// loop of a real arm must also stop at `stale_pose` and `other_side` (docs/controller.md).
Ending run(Changing& engine, std::optional<vfplan::Governor>& governor, const Hand& hand,
           Form& form, std::size_t ticks, bool simulated_time, vfplan::Telemetry* sender,
           Log& log) {
    Tip tip{hand.start(), {}};
    engine.reset(tip.position);
    Ending ending;
    if (!simulated_time) engine.start(period);
    Clock clock(period, simulated_time);
    for (std::size_t k = 0; k < ticks; ++k) {
        ending.missed += clock.wait();
        const double t = double(k) * period;
        if (simulated_time) engine.due(k, t);
        const auto before = std::chrono::steady_clock::now();
        vfplan::Step step = engine.step(t, tip.position);
        const vfplan::Vec3 rendered = step.force;
        if (governor) step.force = governor->step(rendered).force;
        if (sender != nullptr) sender->publish(t, tip.position, step);
        const std::chrono::duration<double, std::micro> took =
            std::chrono::steady_clock::now() - before;
        log.add({t, tip.position, step, rendered, took.count(), engine.seen(), engine.taken()});
        if (step.status & vfplan::bad_hip) ending.bad_tick = k;
        ending.signal = stop_signal;
        if (ending.bad_tick || ending.signal != 0) break;
        std::visit([&](auto& arm) { arm.tick(tip, hand.force(tip, t), step.force, period); }, form);
    }
    engine.finish();
    return ending;
}

/// The fixture, signed by one of the keys. Without keys it is undamaged, which says nothing about
/// who made it: anybody who can write the file can seal another one.
vfplan::bundle::Fixture read_signed(const Options& o, const std::string& path) {
    if (o.unsigned_allowed) {
        vfplan::bundle::Fixture fixture = vfplan::bundle::read_fixture(path);
        std::fprintf(stderr,
                     "controller: warning: %s is loaded without a signature: it is undamaged, but "
                     "anybody may have made it, for any patient. Sign it with `vfplan sign`.\n",
                     path.c_str());
        return fixture;
    }
#ifdef WITH_SIGNATURES
    vfplan::bundle::Trust trust;
    trust.keys = vfplan::bundle::read_keys(o.keys);
    trust.case_token = o.case_token;
    trust.robot_serial = o.robot_serial;
    trust.max_age = o.max_age;
    return vfplan::bundle::read_fixture(path, trust);
#else
    throw UsageError("--keys: this controller was built without OpenSSL. Build it with OpenSSL.");
#endif
}

/// A fixture as it may be rendered: signed if that is demanded, and without open findings.
vfplan::bundle::Fixture read_approved(const Options& o, const std::string& path) {
    vfplan::bundle::Fixture fixture = read_signed(o, path);
    const std::size_t open = fixture.findings_unanswered;
    if (open > 0 && !o.despite_findings) {
        throw vfplan::bundle::BundleError(
            "unsafe.findings", path,
            "open findings of its planning: " + std::to_string(open) +
                ". Answer them with `vfplan review`, or give --despite-findings.");
    }
    if (!fixture.reviewed && !o.unsigned_allowed) {
        std::fprintf(stderr,
                     "controller: warning: %s is signed, but nobody has reviewed its plan. Ask who "
                     "signed it why.\n",
                     path.c_str());
    }
    return fixture;
}

/// The engines that the events exchange, each by its own best rule where the first one's is exact;
/// the stiffness of the stiffest [N/m]. Every event is tried on an engine `trial` first: what it
/// cannot do is found before the loop.
double make_engines(std::vector<Event>& events, const Options& o, vfplan::Rule rule,
                    vfplan::Use use, vfplan::Search search, vfplan::Engine& trial) {
    double stiffness = 0;
    vfplan::Rule now = rule;
    for (Event& event : events) {
        while (trial.changes_pending() > 0) trial.step({});
        if (!event.exchanges()) {
            if (now == vfplan::Rule::exact)
                throw FileError(event.where +
                                ": edit: rule 'exact' renders no points, which "
                                "could be edited. Give --rule robust.");
            hand_over(event, trial, nullptr);
            continue;
        }
        const auto other = read_approved(o, event.bundle.string());
        if (other.frame != "robot_base" || other.guidance)
            throw FileError(event.where +
                            ": no forbidden region in robot_base. Exchange it for one that is.");
        const bool exact = rule == vfplan::Rule::exact;
        const vfplan::Rule own = exact ? vfplan::bundle::best_rule(other) : rule;
        vfplan::Parameters p = vfplan::bundle::parameters(other, own);
        p.search = search;
        Rendered made(other, p, use);
        stiffness = std::max(stiffness, made.stiffness());
        event.engine.emplace(std::move(made.region()));
        hand_over(event, trial, &Rendered(other, p, vfplan::Use::replay).region());
        now = own;
    }
    return stiffness;
}

int control(const Options& o) {
    // Load, check, copy to plain arrays, close: no file meets the loop.
    const vfplan::bundle::Fixture fixture = read_approved(o, o.fixture);
    if (fixture.frame != "robot_base")
        throw FileError(o.fixture + ": the fixture is in the frame " + fixture.frame +
                        ", and the arm moves in robot_base. Register it first: vfplan register.");
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
    const auto use = o.simulated_time ? vfplan::Use::replay : vfplan::Use::real_time;
    vfplan::Parameters p = vfplan::bundle::parameters(fixture, o.rule);
    if (!std::all_of(events.begin(), events.end(), [](auto& e) { return e.exchanges(); }))
        p.search = vfplan::Search::editable;
    Rendered engine(fixture, p, use);
    double stiffest = engine.stiffness();
    if (!events.empty()) {
        Rendered trial(fixture, p, vfplan::Use::replay);
        stiffest =
            std::max(stiffest, make_engines(events, o, p.rule, use, p.search, trial.region()));
    }
    Changing changing(engine, std::move(poses), std::move(events),
                      o.moving.value_or(vfplan::MovingLimits{}));
    const Hand hand(fixture.points, 4 * p.R(), p.ignore_axis, o.seconds);
    const auto ticks = std::size_t(o.seconds / period + 0.5);
    auto governed = governor(o, stiffest);
    const auto sender = telemetry(o.telemetry);
    catch_stop_signals();
    Log log(o.log, ticks, governed.has_value());
    if (changes) log.begun = [&](std::uint64_t taken) { return changing.begun(taken); };
    Form form = o.form;
    // Without page faults later. The system refuses it to a user without the right to.
    mlockall(MCL_CURRENT | MCL_FUTURE);
    const Ending ending =
        run(changing, governed, hand, form, ticks, o.simulated_time, sender.get(), log);
    munlockall();
    log.write();
    log.report(ending.missed);
    changing.report(log.stale());
    if (sender)
        std::printf("telemetry: %llu ticks dropped, %llu datagrams not taken by the system\n",
                    static_cast<unsigned long long>(sender->dropped()),
                    static_cast<unsigned long long>(sender->unsent()));
    if (governed)
        std::printf("governor: gave up to %.4f mJ of %.4f mJ stored\n",
                    1e3 * governed->energy_given(), 1e3 * governed->energy_stored());
    changing.check();
    if (ending.bad_tick) {
        std::cerr << o.fixture << ": the loop stopped in tick " << *ending.bad_tick
                  << ", because the tip's place in the fixture was not finite, or beyond 1e6 m. "
                     "Check the poses and where the tip starts.\n";
        return 1;
    }
    if (ending.signal != 0) {
        std::cerr << o.fixture << ": signal " << ending.signal
                  << " stopped the loop. Start it again for all of its ticks.\n";
        return 128 + ending.signal;
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
