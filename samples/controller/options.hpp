// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The controller's command line.
#pragma once
#include <charconv>
#include <chrono>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <variant>
#include <vector>

#include "arm.hpp"
#include "changing.hpp"
#include "vfplan/controller.hpp"

namespace controller {

using Form = std::variant<Impedance, Admittance, Velocity>;

inline constexpr double period = 1e-3;  // [s]
inline constexpr const char* usage =
    "usage: controller FIXTURE.h5 [options]\n"
    "  --form impedance|admittance|velocity   how the force reaches the arm; impedance\n"
    "  --rule robust|paper|exact              how the proxy moves; exact where the bundle holds\n"
    "                                         lines and arcs, else robust\n"
    "  --seconds S                            how long, from 0.001 to 3600; 5\n"
    "  --log SESSION.csv                      write ticks for `vfplan replay`; a new file\n"
    "  --simulated-time                       do not wait for the clock\n"
    "  --governor STEP,MAX                    force's change a tick and force at most [N]\n"
    "  --poses POSES.csv                      where the moving fixture is\n"
    "  --pose-limits AGE,SPEED,TURN           age of a stale pose, the frame's speeds;\n"
    "                                         0.1,0.25,1 [s, m/s, rad/s]\n"
    "  --pivot X,Y,Z                          the point whose speed is bounded; 0,0,0 [m]\n"
    "  --events EVENTS.csv                    exchanges and edits of the fixture; both files as\n"
    "                                         for `vfplan replay`, in real time from a thread\n"
    "  --telemetry HOST:PORT                  send every tick by UDP, for `vfplan live`\n"
    "  --keys KEYS.pub                        who must have signed the fixture; needed, unless\n"
    "  --unsigned                             take it from anybody: all that is known is that it\n"
    "                                         is undamaged\n"
    "  --case TOKEN, --robot-serial SERIAL    for which case and robot\n"
    "  --max-age TIME                         how long ago it may have been signed: 90s, 30min,\n"
    "                                         12h or 2d\n"
    "  --unreviewed                           take it though nobody has approved its plan\n"
    "  --despite-findings                     take it though findings of its planning are open\n"
    "  --help                                 this page\n"
    "exit: 0 done, 1 stopped at a bad position, 2 bad usage or log, 3 bad input, 4 a bundle that\n"
    "cannot be trusted, 128 + number after a signal\n";

struct UsageError : std::runtime_error {
    using std::runtime_error::runtime_error;
};

struct Options {
    Options() {
        // Without --governor what is commanded is what is rendered. An arm that is simulated goes
        // on whatever else a tick says.
        settings.governor.force_step = settings.governor.force_max = 1e6;
        settings.governor.period = period;
        settings.stop_at = vfplan::Status::bad_hip | vfplan::Status::jumped;
    }

    std::string fixture, log, telemetry, poses, events;
    vfplan::Demand demand;
    vfplan::ControllerSettings settings;
    Form form = Impedance{};
    std::optional<vfplan::Rule> rule;  // without one, the rule nearest to what the bundle holds
    double seconds = 5;
    bool is_governed = false;
    bool simulated_time = false;
};

/// The value of a name; refuses a name that is not among the allowed ones.
template <class T>
T choose(const std::map<std::string, T>& allowed, const std::string& option,
         const std::string& value) {
    const auto found = allowed.find(value);
    if (found != allowed.end()) return found->second;
    std::string names;
    for (const auto& [name, unused] : allowed) names += (names.empty() ? "" : ", ") + name;
    throw UsageError(option + " " + value + " is not known. Give one of " + names + ".");
}

/// How long the loop runs [s]: one tick at least, so that there is something to report.
inline double duration(const std::string& value) {
    double seconds = 0;
    const auto [end, error] = std::from_chars(value.data(), value.data() + value.size(), seconds);
    if (error != std::errc{} || end != value.data() + value.size() ||
        !(seconds >= period && seconds <= 3600))
        throw UsageError("--seconds " + value +
                         " is out of range. Give a number from 0.001 to 3600.");
    return seconds;
}

/// A time with its unit, as the commands of vfplan take it: 90s, 30min, 12h or 2d [s].
inline double age(const std::string& value) {
    const std::map<std::string, double> seconds_of{
        {"s", 1}, {"min", 60}, {"h", 3600}, {"d", 86400}};
    const double longest = 1e9 * seconds_of.at("d");  // [s] as for those commands
    const std::size_t length = std::min(value.find_first_not_of("0123456789."), value.size());
    const std::string digits = value.substr(0, length);
    const auto unit = seconds_of.find(value.substr(length));
    double seconds = longest;
    if (unit != seconds_of.end() && !digits.starts_with('.') && !digits.ends_with('.')) {
        double count = 0;
        const char* const end = digits.data() + digits.size();
        const auto [stop, error] = std::from_chars(digits.data(), end, count);
        if (error == std::errc{} && stop == end) seconds = count * unit->second;
    }
    if (!(seconds < longest))
        throw UsageError("--max-age " + value +
                         " is no time. Give one such as 90s, 30min, 12h or 2d.");
    return seconds;
}

/// As many numbers as the example has, separated by commas.
inline std::vector<double> numbers(const std::string& option, const std::string& value,
                                   const std::string& example) {
    std::vector<double> values;
    try {
        for (const std::string& field : split(value)) values.push_back(number<double>(field));
    } catch (const FileError&) {
        values.clear();
    }
    const std::size_t count = split(example).size();
    if (values.size() != count)
        throw UsageError(option + " " + value + " is not " + std::to_string(count) +
                         " numbers. Give them with commas between, as " + example + ".");
    return values;
}

/// Calls `use`; what it refuses is reported as a mistake in the option.
template <class F>
auto as_option(const std::string& option, F&& use) try {
    return use();
} catch (const std::invalid_argument& error) {
    throw UsageError(option + ": " + reason(error));
}

inline Options parse(const std::vector<std::string>& args) {
    Options o;
    for (std::size_t i = 0; i < args.size(); ++i) {
        const auto value = [&] {
            if (i + 1 == args.size())
                throw UsageError(args[i] + " has no value. Give one after it.");
            return args[++i];
        };
        if (args[i] == "--form")
            o.form = choose<Form>({{"impedance", Impedance{}},
                                   {"admittance", Admittance{}},
                                   {"velocity", Velocity{}}},
                                  "--form", value());
        else if (args[i] == "--rule")
            o.rule = choose<vfplan::Rule>({{"robust", vfplan::Rule::robust},
                                           {"paper", vfplan::Rule::paper},
                                           {"exact", vfplan::Rule::exact}},
                                          "--rule", value());
        else if (args[i] == "--seconds")
            o.seconds = duration(value());
        else if (args[i] == "--log")
            o.log = value();
        else if (args[i] == "--telemetry")
            o.telemetry = value();
        else if (args[i] == "--keys")
            o.demand.keys = {value()};
        else if (args[i] == "--case")
            o.demand.case_id = value();
        else if (args[i] == "--robot-serial")
            o.demand.robot_serial = value();
        else if (args[i] == "--max-age")
            o.demand.max_age_s = age(value());
        else if (args[i] == "--despite-findings")
            o.demand.accept_doubts = true;
        else if (args[i] == "--unreviewed")
            o.demand.accept_unreviewed = true;
        else if (args[i] == "--governor") {
            const std::vector<double> given = numbers("--governor", value(), "1.2,20");
            o.settings.governor.force_step = given[0];
            o.settings.governor.force_max = given[1];
            o.is_governed = true;
        } else if (args[i] == "--poses")
            o.poses = value();
        else if (args[i] == "--events")
            o.events = value();
        else if (args[i] == "--pose-limits" || args[i] == "--pivot") {
            auto& moving = o.settings.moving;
            if (!moving) moving.emplace();
            const std::string option = args[i];
            if (option == "--pivot") {
                const std::vector<double> v = numbers(option, value(), "0,0,0");
                moving->pivot = {{v[0], v[1], v[2]}};
            } else {
                const std::vector<double> v = numbers(option, value(), "0.1,0.25,1");
                moving->max_age = v[0];
                moving->max_speed = v[1];
                moving->max_turn = v[2];
            }
            as_option(option + " " + args[i], [&] { vfplan::MovingFrame frame(*moving); });
        } else if (args[i] == "--simulated-time")
            o.simulated_time = true;
        else if (args[i] == "--unsigned")
            o.demand.accept_unsigned = o.demand.accept_unreviewed = true;
        else if (o.fixture.empty() && !args[i].starts_with("--"))
            o.fixture = args[i];
        else
            throw UsageError(args[i] + " is not understood. Give one fixture and known options.");
    }
    if (o.fixture.empty()) throw UsageError("No fixture is named. Give FIXTURE.h5.");
    if (o.settings.moving && o.poses.empty())
        throw UsageError("--pose-limits and --pivot need a fixture that moves. Give --poses too.");
    const vfplan::Demand& demand = o.demand;
    if (demand.keys.empty() && (demand.case_id || demand.robot_serial || demand.max_age_s))
        throw UsageError(
            "--case, --robot-serial and --max-age read a signature. Give --keys KEYS.pub too.");
    if (demand.keys.empty() != demand.accept_unsigned)
        throw UsageError(
            "It is not said who may have made the fixture. Give either --keys KEYS.pub, who must "
            "have signed it, or --unsigned, which takes it from anybody.");
    return o;
}

}  // namespace controller
