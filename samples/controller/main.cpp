// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// A 1 kHz controller on a simulated arm. What a real one does differently stands in
// docs/controller.md: where the tip's position comes from, and where the force goes.
#include <algorithm>
#include <charconv>
#include <iostream>
#include <map>
#include <memory>
#include <optional>
#include <variant>

#include "arm.hpp"
#include "hand.hpp"
#include "loop.hpp"
#include "rendered.hpp"
#ifdef WITH_SIGNATURES
#include "vfplan/bundle/trust.hpp"
#endif
#include "vfplan/governor.hpp"
#include "vfplan/telemetry.hpp"

namespace {

using namespace controller;
using Form = std::variant<Impedance, Admittance, Velocity>;

constexpr double period = 1e-3;  // [s]
constexpr const char* usage =
    "usage: controller FIXTURE.h5 [options]\n"
    "  --form impedance|admittance|velocity   how the force reaches the arm; impedance\n"
    "  --rule robust|paper|exact              how the proxy moves; exact where the bundle holds\n"
    "                                         lines and arcs, else robust\n"
    "  --seconds S                            how long, up to 3600; 5\n"
    "  --log SESSION.csv                      write ticks for `vfplan replay`; a new file\n"
    "  --simulated-time                       do not wait for the clock\n"
    "  --governor STEP,MAX                    force's change a tick and force at most [N]\n"
    "  --telemetry HOST:PORT                  send every tick by UDP, for `vfplan live`\n"
    "  --keys KEYS.pub                        who must have signed the fixture; wanted, unless\n"
    "  --unsigned                             take it from anybody: all that is known is that it\n"
    "                                         is undamaged\n"
    "  --case TOKEN, --robot-serial SERIAL    for which case and robot\n"
    "  --help                                 this page\n"
    "exit: 0 done, 2 usage, 3 bad input, 4 a bundle that cannot be trusted\n";

struct UsageError : std::runtime_error {
    using std::runtime_error::runtime_error;
};

struct Options {
    std::string fixture, log, telemetry, keys;
    std::optional<std::string> case_token, robot_serial;
    Form form = Impedance{};
    std::optional<vfplan::Rule> rule;  // else the one nearest to what the bundle holds
    double seconds = 5;
    std::optional<vfplan::GovernorLimits> governor;
    bool simulated_time = false, from_anybody = false;
};

template <class T>
T choose(const std::map<std::string, T>& allowed, const std::string& option,
         const std::string& value) {
    const auto found = allowed.find(value);
    if (found != allowed.end()) return found->second;
    std::string names;
    for (const auto& [name, unused] : allowed) names += (names.empty() ? "" : ", ") + name;
    throw UsageError(option + " " + value + ": allowed are " + names);
}

double positive(const std::string& option, const std::string& value) {
    double number = 0;
    const auto [end, error] = std::from_chars(value.data(), value.data() + value.size(), number);
    if (error != std::errc{} || end != value.data() + value.size() ||
        !(number > 0 && number <= 3600))
        throw UsageError(option + " " + value + ": allowed is above 0 and at most 3600");
    return number;
}

vfplan::GovernorLimits limits(const std::string& value) {
    const std::size_t comma = std::min(value.find(','), value.size() - 1);
    vfplan::GovernorLimits limits;
    limits.force_step = positive("--governor", value.substr(0, comma));
    limits.force_max = positive("--governor", value.substr(comma + 1));
    limits.period = period;
    return limits;
}

/// Its sender, when ticks are to be sent; made before the loop.
std::unique_ptr<vfplan::Telemetry> telemetry(const std::string& value) {
    if (value.empty()) return nullptr;
    const std::size_t colon = std::min(value.rfind(':'), value.size());
    const char* const end = value.data() + value.size();
    const char* const digits = std::min(value.data() + colon + 1, end);
    std::uint16_t port = 0;
    const auto [stop, error] = std::from_chars(digits, end, port);
    if (error != std::errc{} || stop != end)
        throw UsageError("--telemetry " + value + ": HOST:PORT is wanted, as 127.0.0.1:5005");
    try {
        return std::make_unique<vfplan::Telemetry>(port, value.substr(0, colon));
    } catch (const std::invalid_argument& wrong) {
        throw UsageError("--telemetry " + value + ": " + wrong.what());
    }
}

Options parse(const std::vector<std::string>& args) {
    Options o;
    for (std::size_t i = 0; i < args.size(); ++i) {
        const auto value = [&] {
            if (i + 1 == args.size()) throw UsageError(args[i] + ": a value is missing");
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
            o.seconds = positive("--seconds", value());
        else if (args[i] == "--log")
            o.log = value();
        else if (args[i] == "--telemetry")
            o.telemetry = value();
        else if (args[i] == "--keys")
            o.keys = value();
        else if (args[i] == "--case")
            o.case_token = value();
        else if (args[i] == "--robot-serial")
            o.robot_serial = value();
        else if (args[i] == "--governor")
            o.governor = limits(value());
        else if (args[i] == "--simulated-time")
            o.simulated_time = true;
        else if (args[i] == "--unsigned")
            o.from_anybody = true;
        else if (o.fixture.empty() && !args[i].starts_with("--"))
            o.fixture = args[i];
        else
            throw UsageError(args[i] + ": not understood");
    }
    if (o.fixture.empty()) throw UsageError("FIXTURE.h5 is missing");
    if (o.keys.empty() && (o.case_token || o.robot_serial))
        throw UsageError("--case and --robot-serial need --keys: the signature covers them");
    if (o.keys.empty() != o.from_anybody)
        throw UsageError(
            "either --keys KEYS.pub, who must have signed the fixture, or --unsigned, which takes "
            "what anybody may have made");
    return o;
}

/// The arm's side: a governor that may let go of the fixture's whole spring. What is not passive
/// with this stiffness and the arm's mass is refused here.
std::optional<vfplan::Governor> governor(const Options& o, double stiffness) {
    if (!o.governor) return std::nullopt;
    vfplan::GovernorLimits limits = *o.governor;
    limits.stiffness = stiffness;
    return vfplan::Governor(limits);
}

/// The loop: read the tip, render, govern, show the tick, hand the force to the arm. Nothing in
/// it allocates or waits.
std::size_t run(Rendered& engine, std::optional<vfplan::Governor>& governor, const Hand& hand,
                Form& form, std::size_t ticks, bool simulated_time, vfplan::Telemetry* sender,
                Log& log) {
    Tip tip{hand.start(), {}};
    engine.reset(tip.position);
    std::size_t missed = 0;
    Clock clock(period, simulated_time);
    for (std::size_t k = 0; k < ticks; ++k) {
        missed += clock.wait();
        const double t = double(k) * period;
        const auto before = std::chrono::steady_clock::now();
        vfplan::Step step = engine.step(tip.position);
        const vfplan::Vec3 rendered = step.force;
        if (governor) step.force = governor->step(rendered).force;
        if (sender != nullptr) sender->publish(t, tip.position, step);
        const std::chrono::duration<double, std::micro> took =
            std::chrono::steady_clock::now() - before;
        log.add({t, tip.position, step, rendered, took.count()});
        std::visit([&](auto& arm) { arm.tick(tip, hand.force(tip, t), step.force, period); }, form);
    }
    return missed;
}

/// The fixture, approved by one of the keys. Without keys it is whole and undamaged, which says
/// nothing of who made it: anybody who can write the file can seal another one.
vfplan::bundle::Fixture approved(const Options& o) {
    if (o.from_anybody) {
        std::fprintf(stderr,
                     "controller: warning: %s is loaded without a signature: it is undamaged, but "
                     "anybody may have made it, for any patient\n",
                     o.fixture.c_str());
        return vfplan::bundle::read_fixture(o.fixture);
    }
#ifdef WITH_SIGNATURES
    vfplan::bundle::Trust trust;
    trust.keys = vfplan::bundle::read_keys(o.keys);
    trust.case_token = o.case_token;
    trust.robot_serial = o.robot_serial;
    return vfplan::bundle::read_fixture(o.fixture, trust);
#else
    throw UsageError("--keys: this controller was built without OpenSSL");
#endif
}

int control(const Options& o) {
    // Load, check, copy to plain arrays, close: no file meets the loop.
    const vfplan::bundle::Fixture fixture = approved(o);
    if (fixture.frame != "robot_base")
        throw std::invalid_argument("vfplan: frame " + fixture.frame + "; robot_base wanted");
    const auto use = o.simulated_time ? vfplan::Use::offline : vfplan::Use::real_time;
    const vfplan::Parameters p = vfplan::bundle::parameters(fixture, o.rule);
    Rendered engine(fixture, p, use);
    const Hand hand(fixture.points, 4 * p.R(), p.ignore_axis, o.seconds);
    const auto ticks = std::size_t(o.seconds / period + 0.5);
    auto governed = governor(o, engine.stiffness());
    Log log(ticks, governed.has_value());
    Form form = o.form;
    const auto sender = telemetry(o.telemetry);
    mlockall(MCL_CURRENT | MCL_FUTURE);  // no page faults later; refused without the right to
    const std::size_t missed =
        run(engine, governed, hand, form, ticks, o.simulated_time, sender.get(), log);
    munlockall();
    if (!o.log.empty()) log.write(o.log);
    log.report(missed);
    if (sender)
        std::printf("telemetry: %llu ticks dropped, %llu datagrams not taken by the system\n",
                    static_cast<unsigned long long>(sender->dropped()),
                    static_cast<unsigned long long>(sender->unsent()));
    if (governed)
        std::printf("governor: gave up to %.4f mJ of %.4f mJ stored\n",
                    1e3 * governed->energy_given(), 1e3 * governed->energy_stored());
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
        std::cerr << error.what() << "\n" << usage;
        return 2;
    } catch (const vfplan::bundle::BundleError& error) {
        std::cerr << error.what() << "\n";  // names the file
        return error.kind() == "InputError" ? 3 : 4;
    } catch (const std::exception& error) {
        std::cerr << options.fixture << ": " << error.what() << "\n";
        return 3;
    }
}
