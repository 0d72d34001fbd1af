// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// What converts to and from Vec3, poses by rows and by columns, and a status through the governor.
#include <array>
#include <cassert>
#include <cstring>
#include <vector>

#include "vfplan/bundle/engine.hpp"
#include "vfplan/controller.hpp"
#include "vfplan/engine.hpp"
#if __has_include(<eigen3/Eigen/Core>)
#include <eigen3/Eigen/Core>
#endif
using vfplan::Vec3;
struct Own {
    double x[3];
    double operator[](int i) const { return x[i]; }
    double& operator[](int i) { return x[i]; }
};
static_assert(std::is_convertible_v<std::array<double, 3>, Vec3> &&
              std::is_convertible_v<Vec3, std::array<double, 3>>);
static_assert(!std::is_convertible_v<std::array<double, 16>, Vec3> &&
              !std::is_convertible_v<std::vector<double>, Vec3>);
static_assert(!std::is_convertible_v<const double*, Vec3>);
static_assert(!std::is_convertible_v<double[16], Vec3>);
static_assert(std::is_trivially_copyable_v<Vec3>);
// Nothing that a controller shows can change what stops it or what K is at most.
using Shown = const vfplan::Controller&;
static_assert(std::is_same_v<decltype(std::declval<Shown>().region()), const vfplan::Engine*> &&
              std::is_same_v<decltype(std::declval<Shown>().frame()), const vfplan::MovingFrame*> &&
              std::is_same_v<decltype(std::declval<Shown>().governor()), const vfplan::Governor&>);
int main() {
    const Vec3 a(1, 2, 3), b{{1, 2, 3}}, c = std::array<double, 3>{1, 2, 3}, d = Own{{1, 2, 3}},
                                         e{1.0, 2.0, 3.0};
    assert(a == b && a == c && a == d && a == e);
    assert(-a == Vec3(-1, -2, -3) && a * 2.0 == Vec3(2, 4, 6) && a / 2 == Vec3(0.5, 1, 1.5));
    Vec3 s = a;
    s += a;
    s -= b;
    s *= 3;
    assert(s == Vec3(3, 6, 9));
    std::array<double, 3> back = a;
    Own own = a;
    assert(back[2] == 3 && own[1] == 2);
    Vec3 z{{}};
    assert(z == Vec3{});
    vfplan::GovernorLimits l;
    vfplan::Governor g(l);
    vfplan::Step st;
    st.status = vfplan::Status::bad_hip;
    assert(g.step(st).engine == vfplan::Status::bad_hip);
    double rows[16] = {0, -1, 0, 5, 1, 0, 0, 6, 0, 0, 1, 7, 0, 0, 0, 1}, cols[16];
    for (int i = 0; i < 16; ++i) cols[i] = rows[4 * (i % 4) + i / 4];
    auto p = vfplan::Pose::of_rows(rows), q = vfplan::Pose::of_columns(cols);
    assert(p.place == q.place && p.w == q.w && p.v == q.v &&
           norm(p.out(Vec3(1, 0, 0)) - Vec3(5, 7, 7)) < 1e-12);
    int thrown = 0;
    for (auto* m : {rows, cols}) try {
            m == rows ? vfplan::Pose::of_columns(m) : vfplan::Pose::of_rows(m);
        } catch (const std::invalid_argument&) {
            ++thrown;
        }
    assert(thrown == 2);
    const double point[3] = {0, 0, 0};
    vfplan::Engine given(point, 1, vfplan::Parameters{}), taken = std::move(given);
    given.reset(a);
    assert(given.step(a).status == vfplan::Status::bad_hip && given.step(a).force == Vec3{});
    std::string why;
    const auto refused = [&](const auto& act) {
        try {
            act();
        } catch (const std::exception& error) {
            why = error.what();
            return true;
        }
        return false;
    };
    assert(given.was_exchanged() && given.bytes() == 0 && given.distance(a) > 1e9);
    // After a reset a bad position keeps its place, also where changes were handed over.
    taken.set_stiffness(a);
    taken.reset(a);
    assert(taken.step(Vec3(NAN, 0, 0)).proxy == a);
    assert(refused([&] { given.set_stiffness(a); }) &&
           refused([&] { taken.exchange(std::move(given)); }));
    vfplan::bundle::Fixture wall;
    wall.points = {0, 0, 0};
    wall.frame = "robot_base";
    wall.rendering.emplace();  // 1000 N/m, 5 mm, a band of 10 um
    vfplan::Controller moved(wall), holds = std::move(moved);
    moved.reset(a);
    assert(holds.size() == 1 && moved.size() == 0 && moved.step(a).stop);
    assert(refused([&] { moved.add(wall); }) && refused([&] { moved.set_stiffness(500); }));
    // What no arm has is refused, and a loop stops at a lost position whatever the caller chooses.
    const auto with = [&](auto&& change) {
        return refused([&] {
            vfplan::ControllerSettings settings;
            change(settings);
            vfplan::Controller controller(wall, {}, settings);
        });
    };
    assert(!with([](auto& s) { s.stop_at |= vfplan::Status::inside; }));
    for (const int bits : {0, 1, 64, 255}) {
        assert(with([&](auto& s) { s.stop_at = bits; }));
        assert((why.find("capped") != why.npos) == (bits == 255));
        assert(why.find("Give") != why.npos);
    }
    for (const double value : {-1.0, 1e9, vfplan::infinity}) {
        assert(with([&](auto& s) { s.max_hip_step = value; }));
        assert(with([&](auto& s) { s.governor.force_step = value; }));
    }
    assert(refused([&] { holds.set_stiffness(1001); }) && holds.set_stiffness(900));
    const auto has_no_fixture_3 = [&](const auto& act) {
        return refused(act) &&
               why.find("which is 3. Give a value of at least 0 and at most 0") == 8;
    };
    assert(has_no_fixture_3([&] { holds.contact_radius(3); }) &&
           has_no_fixture_3([&] { holds.rule(3); }) && has_no_fixture_3([&] { holds.region(3); }) &&
           has_no_fixture_3([&] { holds.set_stiffness(1, 3); }) &&
           has_no_fixture_3([&] { holds.exchange(wall, 3); }));
    // The next good tick does not begin a loop whose reset was nowhere.
    vfplan::Controller unplaced(wall);
    unplaced.reset(Vec3(std::nan(""), 0, 0));
    assert(unplaced.step(a).stopping == vfplan::Status::bad_hip && unplaced.step(a).stop);
    unplaced.reset(a);
    assert(unplaced.step(a).stopping == 0);
    // What an arm would not get as it is stops the loop.
    assert(unplaced.pose(0, {}) == false &&
           unplaced.step(a).stopping == vfplan::Status::stale_pose);
    using Says = vfplan::GovernorStatus;
    vfplan::ControllerSettings torques;
    torques.governor.torque_max[0] = 5;
    vfplan::Controller blind(wall, {}, torques);
    blind.reset(a);
    assert(blind.step(a).stopping == Says::no_jacobian << 8);
    const double wide[3 * 17] = {};
    for (const int joints : {-1, 0, 17, 1000})
        assert(g.step(a, wide, joints).status & Says::bad_jacobian);
    assert(g.step(a, wide, 16).status == 0);
    // A fixture that is added in contact changes the force by no more than the governor lets it.
    vfplan::bundle::Fixture beside = wall;
    beside.points = {0, 0, 1e-4};
    vfplan::Controller pressed(wall);
    pressed.reset(Vec3(0, 0, 0.01));
    Vec3 force;
    for (int i = 0; i < 200; ++i)
        force = pressed.step(Vec3(0, 0, std::max(0.01 - 1e-4 * i, 1e-3))).force;
    assert(std::abs(force[2] - 4) < 0.1);
    pressed.add(beside);
    for (int i = 0; i < 9; ++i) {
        const Vec3 next = pressed.step(Vec3(0, 0, 1e-3)).force;
        assert(norm(next - force) <= 1);
        force = next;
    }
    // Radii that no engine takes are refused before anything is made of them.
    const double line[6] = {0, 0, 0, 0.1, 0, 0};
    vfplan::bundle::Fixture drawn = wall, skin = wall;
    drawn.pieces = {{{line, line + 6}, {0, 0}, false}};
    drawn.rendering->ignore_axis = Vec3(0, 0, 1);
    skin.points = {0, 0, 0, 0.1, 0, 0, 0, 0.1, 0};
    skin.mesh = {0, 1, 2};
    for (vfplan::bundle::Fixture fixture : {drawn, skin, wall}) {
        assert(!refused([&] { vfplan::Controller good(fixture); }));
        for (const double radius : {0.0, -1.0, -1e-3, double(NAN)}) {
            fixture.rendering->contact_radius = radius;
            assert(refused([&] { vfplan::Controller bad(fixture); }));
            assert(why.find("contact_radius") != why.npos);
        }
    }
    // Whatever changes a fixture keeps to the governor's bound on K, and one that is spent is none.
    vfplan::bundle::Fixture stiff = wall, soft = wall;
    stiff.rendering->stiffness = {3000, 3000, 3000};
    soft.rendering->stiffness = {500, 500, 500};
    vfplan::ControllerSettings fast, slow, edits;
    slow.governor.force_step = 0.35;  // passive to 1225 N/m
    edits.search = vfplan::Search::editable;
    vfplan::Controller bounded(wall, {}, slow), made(stiff, {}, fast), other(soft),
        edited(wall, {}, edits);
    assert(refused([&] { bounded.exchange(std::move(made)); }) && bounded.stiffness() == 1000);
    assert(bounded.exchange(std::move(other)) && bounded.stiffness() == 500);
    assert(refused([&] { bounded.set_stiffness(501); }));
    assert(refused([&] { bounded.exchange(std::move(other)); }));
    // A controller that is given in exchange has met the same demands, and is told where it has
    // not.
    vfplan::Demand demand;
    demand.keys = {"a.pub", "b.pub"};
    demand.case_id = demand.robot_serial = demand.tool = "1";
    demand.max_age_s = 60;
    edits.max_stiffness = 1000;
    edits.governor.force_step = 5;
    vfplan::Controller strict(wall, demand, edits);
    const auto differs_in = [&](const char* what, const auto& change) {
        vfplan::Demand has = demand;
        vfplan::ControllerSettings settings = edits;
        change(has, settings);
        vfplan::Controller weak(wall, has, settings);
        try {
            return strict.exchange(std::move(weak)) && !*what;
        } catch (const std::invalid_argument& error) {
            return std::strstr(error.what(), what) && weak.size() == 1 &&
                   weak.rule() == strict.rule();
        }
    };
    using D = vfplan::Demand;
    using S = vfplan::ControllerSettings;
    assert(differs_in("in keys.", [](D& d, S&) { d.keys.clear(); }));
    assert(differs_in("in keys.", [](D& d, S&) { d.keys.push_back("c.pub"); }));
    assert(differs_in("in case_id.", [](D& d, S&) { d.case_id = "2"; }));
    assert(differs_in("in robot_serial.", [](D& d, S&) { d.robot_serial.reset(); }));
    assert(differs_in("in max_age_s.", [](D& d, S&) { d.max_age_s = 61; }));
    assert(differs_in("in tool.", [](D& d, S&) { d.tool.reset(); }));
    assert(differs_in("in accept_unreviewed.", [](D& d, S&) { d.accept_unreviewed = true; }));
    assert(differs_in("in accept_doubts.", [](D& d, S&) { d.accept_doubts = true; }));
    assert(differs_in("in any_tick_time.", [](D&, S& s) { s.any_tick_time = true; }));
    assert(differs_in("in period.", [](D&, S& s) { s.governor.period = 5e-4; }));
    assert(differs_in("in max_stiffness.", [](D&, S& s) { s.max_stiffness = 1001; }));
    assert(differs_in("in search.", [](D&, S& s) { s.search = vfplan::Search::automatic; }));
    vfplan::Controller both(wall, demand, edits);
    vfplan::Demand anybody;
    anybody.accept_unsigned = true;
    vfplan::Controller unsigned_one(wall, anybody);
    both.add(soft);
    assert(refused([&] { strict.exchange(std::move(both)); }) && both.size() == 2);
    assert(refused([&] { holds.exchange(std::move(unsigned_one)); }));
    assert(differs_in("", [](D& d, S&) { d.keys.pop_back(), d.max_age_s = 59; }));
    strict.collect();
    const double more[3] = {0, 0, 0.1};
    assert(refused([&] { bounded.edit(nullptr, 0, more, 1); }));
    assert(edited.edit(nullptr, 0, more, 1) && edited.remake());
    for (int i = 0; i < 3; ++i) edited.step(a);
    assert(edited.region()->distance(Vec3(0, 0, 0.1)) == 0);
    vfplan::MovingFrame frame;
    assert(!frame.pose(0, {{0, 500, 0}, 1, {}}) && frame.pose(0, {{0, 99, 0}, 1, {}}));
    // A rule that asks for a path which the format does not have is not answered that it is absent.
    const vfplan::bundle::Content empty;
    assert(!empty.has("/sigma") && !empty.has_group("/mesh"));
    assert(refused([&] { (void)empty.has("/sgima"); }) &&
           refused([&] { (void)empty.has_group("/mseh"); }));
    assert(taken.set_stiffness(Vec3(500, 500, 500)) &&
           taken.parameters().stiffness == Vec3(500, 500, 500));
#if __has_include(<eigen3/Eigen/Core>)
    Eigen::Vector3d ev(1, 2, 3);
    Vec3 fe = ev;
    Eigen::Vector3d be = a;
    assert(fe == a && be == ev);
#endif
}
