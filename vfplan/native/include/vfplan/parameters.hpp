// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// What an engine is given (Table I of the paper, in SI units), and what each tick answers.
#pragma once

#include "vfplan/base/vec.hpp"
#include "vfplan/rules/constants.hpp"

namespace vfplan::inline v1 {

/// Radii that float64 serves among coordinates of up to 1e6 m: their squares neither under- nor
/// overflow, in the float32 seeds of the loops either (1e-38 to 3e38).
inline constexpr double smallest_radius = 1e-9;  // [m]
inline constexpr double largest_radius = 1e6;    // [m]

/// Of R. The square of a distance is rounded to 2e-16 of itself, and a step's least counted part is
/// a millionth of the band: below, the proxy lags and eq. (1) loses its digits.
inline constexpr double finest_band = 1e-8;
/// Roundings of the largest coordinate that a band holds: its hundredth, rest, is a hundred still.
inline constexpr double roundings_a_band = 1e4;

/// The most that a tick may take in a loop of 1 kHz [s]: what is left of the millisecond is the
/// robot's and the operating system's.
inline constexpr double max_tick_time = 0.3e-3;

enum class Rule { robust, paper, exact };
/// `editable`: for Engine::edit; of the robust rule.
enum class Search { automatic, grid, brute, editable };

struct Parameters {
    double contact_radius = 5e-3;  ///< r_c [m]
    double band = 1e-5;  ///< r2 - r_c = r_c - r1 [m]; `band_for` (cloud/band.hpp) has a cloud's
    double point_radius = 0;             ///< r_v [m]
    double outer_radius = 1e-2;          ///< r3 [m]
    double gain = 1;                     ///< xi of eq. (5)
    Vec3 stiffness{{1000, 1000, 1000}};  ///< diagonal of K [N/m]
    std::optional<Vec3> ignore_axis;     ///< unit vector along which the fixture is infinite
    Rule rule = Rule::robust;
    Search search = Search::automatic;
    int max_iterations = 16;     ///< of the robust rule, a tick
    double max_hip_step = 0.02;  ///< a HIP further than this from the last counts as no HIP [m];
                                 ///< 0: none does
    double period = 1e-3;        ///< of a tick, by which the force is led from one to another [s]

    double r1() const noexcept { return contact_radius - band; }
    double r2() const noexcept { return contact_radius + band; }
    /// R = r_c + r_v, where the proxy rests on a point.
    double R() const noexcept { return contact_radius + point_radius; }
    /// How many milliseconds a tick takes: ramps are given a millisecond.
    double pace() const noexcept { return period / 1e-3; }
    /// The largest of K [N/m].
    double stiffest() const noexcept { return std::ranges::max(stiffness.c); }

    bool operator==(const Parameters&) const = default;
};

/// Tells a HIP that no hand can have reached since the last one.
struct HipGate {
    static constexpr Vec3 nowhere{{infinity, 0, 0}};  ///< what an engine takes for no HIP

    Vec3 last;
    bool has_last = false;

    void reset(const Vec3& hip) noexcept {
        has_last = is_within_range(hip);
        last = hip;
    }
    bool refuses(const Vec3& hip, double max_step) const noexcept {
        return has_last && max_step > 0 && is_within_range(hip) && norm(hip - last) > max_step;
    }
};

/// Throws OutOfRange unless each of K is above 0 and finite.
inline void check_stiffness(const Vec3& k) {
    for (int i = 0; i < 3; ++i) check_above("stiffness", k[i], 0, infinity, " N/m");
}

/// Throws OutOfRange where no hand moves so far in a tick.
inline void check_hip_step(double step) {
    check_from("max_hip_step", step, 0, 1, " m", "0, which means off, to 1 m");
}

/// Throws std::invalid_argument unless this is a unit vector.
inline void check_axis(const Vec3& axis) {
    const double length = norm(axis);
    if (!(std::abs(length - 1) < 1e-9))
        reject("ignore_axis has length " + shown(length) + ". Give a unit vector.");
}

/// Throws OutOfRange on a radius outside its range.
inline void check_radii(const Parameters& p) {
    check_from("contact_radius", p.contact_radius, smallest_radius, largest_radius, " m");
    check_from("point_radius", p.point_radius, 0, largest_radius, " m");
}

/// Throws OutOfRange, with name and value, on a parameter outside its range, and
/// std::invalid_argument on an axis that is no unit vector.
inline void check(const Parameters& p) {
    check_radii(p);
    check_above("band", p.band, 0, p.contact_radius, " m", "at most contact_radius");
    check_from("band", p.band, finest_band * p.R(), p.contact_radius, " m",
               "1e-8 (r_c + r_v) to contact_radius");
    check_above("outer_radius", p.outer_radius, p.r2(), 2 * largest_radius, " m", "r3 > r2");
    check_above("gain", p.gain, 0, 1, "");
    check_stiffness(p.stiffness);
    if (p.ignore_axis) check_axis(*p.ignore_axis);
    check_hip_step(p.max_hip_step);
    check_from("period", p.period, 1e-6, 1, " s");
    check_from("rule", int(p.rule), 0, int(Rule::exact), "", "robust, paper or exact");
    check_from("search", int(p.search), 0, int(Search::editable), "");
    check_from("max_iterations", p.max_iterations, 1, std::numeric_limits<int>::max(), "");
}

/// The largest coordinate of n points [m].
inline double largest_of(const double* xyz, std::size_t n) noexcept {
    double largest = 0;
    for (std::size_t i = 0; i < 3 * n; ++i) largest = std::max(largest, std::abs(xyz[i]));
    return largest;
}

/// The least band that coordinates of this size resolve [m].
inline double resolved_band(double largest) noexcept {
    return roundings_a_band * std::numeric_limits<double>::epsilon() * largest;
}

/// The band of rule exact among such coordinates [m]: by how much roundings, and of a mesh a file's
/// single precision, may let the proxy sink.
inline double exact_band(const Parameters& p, double largest) noexcept {
    const double share = p.ignore_axis ? 1e-7 : 1e-5;
    return std::max(share * p.R(), resolved_band(largest));
}

/// Throws OutOfRange where the coordinates of the n points `xyz` are too large to resolve the band.
inline void check_resolved(const Parameters& p, const double* xyz, std::size_t n) {
    const double largest = largest_of(xyz, n), least = resolved_band(largest);
    const std::string why = "1e4 roundings of the largest coordinate, " + shown(largest) + " m";
    check_from("band", p.band, least, infinity, " m", why.c_str());
}

/// The paper's state of the proxy.
enum class State : std::int8_t {
    no_neighbour = -1,
    free_motion = 0,
    in_contact = 1,
    entrenched = 2
};

/// What a tick has to say beside its result; bits, 0 when all is well.
struct Status {
    enum Bit : std::uint8_t {
        ok = 0,
        bad_hip = 1,      ///< HIP not finite or beyond 1e6 m: the proxy stayed, the force is its
                          ///< last; before the first good HIP both are 0
        inside = 2,       ///< started inside: the proxy is led out and handed to the rule
        limit = 4,        ///< the tick used up its iterations or its work; the proxy is safe and
                          ///< goes on next tick
        stale_pose = 8,   ///< the moving fixture's pose is too old: its last frame stands; before
                          ///< the first pose nothing is rendered
        changing = 16,    ///< the fixture was exchanged or edited: the force is on its way to K
                          ///< (proxy - HIP)
        other_side = 32,  ///< with `inside`: no way out was found on the side where the proxy was
                          ///< before the exchange; of a Controller also: the reset was beyond a
                          ///< wall from where the proxy was before
        jumped = 64,      ///< the HIP is further than max_hip_step from the last good one: as
                          ///< bad_hip, until it is back or the engine is reset
        capped = 128      ///< of a Controller: the fixtures' force is larger than the governor's
                          ///< force_max or torque_max lets it be, or of one's force less arrives
                          ///< because another one pushes against it
    };
};
inline constexpr auto jumped = Status::jumped;

/// What a rule says of a tick, in the space it works in.
template <int D>
struct RuleAnswer {
    Vec<D> normal;
    State state = State::no_neighbour;
    std::uint8_t status = Status::ok;
};

struct Step {
    Vec3 proxy{};   ///< [m]
    Vec3 normal{};  ///< unit, 0 when there is none. Rule exact on a mesh, once the proxy has come
                    ///< out and while the status still has `inside`: at the end of its way,
                    ///< whatever the state says of the place where it is
    Vec3 force{};   ///< on the hand [N]
    State state = State::no_neighbour;
    std::uint8_t status = Status::ok;
};

/// What an open curve's ends do.
enum class Ends {
    stop,  ///< a cap closes the tube
    open   ///< the tip goes free there; the force that was left dies down without giving energy
};
/// When the guide takes hold of the tip.
enum class Hold {
    at_once,  ///< at the first tick, with whatever force that takes
    on_entry  ///< once the tip is within the tube; there is no force before
};

struct GuideParameters {
    double radius = 1e-3;     ///< rho, of the tube [m]
    double stiffness = 1000;  ///< K beyond it [N/m]
    Ends ends = Ends::stop;
    Hold hold = Hold::at_once;
    bool cut_bends = false;           ///< takes bends that are tighter than the tube is wide
    std::optional<Vec3> ignore_axis;  ///< unit vector along which curve and tube are infinite
    double lead_force = 0;            ///< pull along the curve [N]; below 0: towards its beginning
    double lead_speed = 0.02;         ///< at which the pull has fallen to 0 [m/s]
    double period = 1e-3;             ///< of a tick, for that speed [s]

    bool operator==(const GuideParameters&) const = default;
};

}  // namespace vfplan::inline v1
