// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The Python face of what stands beside an engine: guide, governor and moving frame. No logic here.
#include <nanobind/stl/array.h>
#include <nanobind/stl/vector.h>

#include "ticks.hpp"
#include "vfplan/moving.hpp"

namespace {

// Points of the curve (M, 3) at arc lengths.
nb::object at(const Guide& guide, std::size_t strand, const std::vector<double>& arcs) {
    if (strand >= guide.path().strands().size()) throw nb::index_error("there is no such strand");
    auto out = array<double>(arcs.size(), 3);
    for (std::size_t i = 0; i < arcs.size(); ++i) {
        const vfplan::Vec3 x = guide.path().at(strand, arcs[i]) + guide.along_axis();
        std::memcpy(out.data() + 3 * i, x.c, sizeof x.c);
    }
    return nb::cast(out);
}

nb::object tight_bend(const Guide& guide) {
    const vfplan::TubeObstacle n = vfplan::tight_bend(guide.path(), guide.parameters().radius);
    if (!n.found) return nb::none();
    return nb::make_tuple(n.strand, n.arc, n.at + guide.along_axis());
}

using Jacobians = nb::ndarray<const double, nb::shape<-1, 3, -1>, nb::c_contig, nb::device::cpu>;

// Torque (T, n); and force (T, 3), what was held back and status (T,).
nb::tuple govern(Governor& governor, const Rows& forces,
                 const std::optional<Jacobians>& jacobians) {
    const Use turn(governor);
    const std::size_t n = forces.shape(0), joints = jacobians ? jacobians->shape(2) : 0;
    auto torque = array<double>(n, joints);
    double* to = torque.data();
    const auto tick = [&](std::size_t i) noexcept {
        const vfplan::Vec3 asked = vfplan::point_at(forces.data(), i);
        if (!jacobians) return governor.step(asked);
        const vfplan::Governed g =
            governor.step(asked, jacobians->data() + 3 * joints * i, int(joints));
        std::copy_n(governor.torque(), joints, to + joints * i);
        return g;
    };
    using vfplan::Governed;
    const nb::tuple governed =
        table(n, tick, &Governed::force, &Governed::held_back, &Governed::status);
    return nb::make_tuple(torque, governed);
}

// A member, which no other thread calls meanwhile.
template <class F>
auto alone(F member) {
    return [member](Governor& governor) {
        const Use turn(governor);
        return (governor.*member)();
    };
}

using Quaternion = nb::ndarray<const double, nb::shape<4>, nb::c_contig, nb::device::cpu>;
using vfplan::MovingFrame, vfplan::Pose, vfplan::Vec3;

void write(const Pose& pose, double* to) noexcept {
    const double all[7] = {pose.place[0], pose.place[1], pose.place[2], pose.w,
                           pose.v[0],     pose.v[1],     pose.v[2]};
    std::copy_n(all, 7, to);
}

// The answers of an engine or a guide in its frame, with the frame's poses (T, 7) and their ages
// (T,).
template <class E>
nb::tuple run_in_frame(MovingFrame& f, E& engine, const Numbers& t, const Rows& hips) {
    const Use turn(engine);
    const std::size_t n = hips.shape(0);
    if (t.shape(0) != n) throw std::invalid_argument("vfplan: a time a HIP");
    auto poses = array<double>(n, 7), ages = array<double>(n, 1);
    double *p = poses.data(), *a = ages.data();
    const nb::tuple rows = answers(hips, [&](std::size_t i, const Vec3& hip) noexcept {
        const auto s = f.step(engine, t.data()[i], hip);
        write(f.now(), p + 7 * i);
        a[i] = f.age();
        return s;
    });
    return nb::make_tuple(rows, poses, ages);
}

}  // namespace

void bind_beside(nb::module_& m) {
    using vfplan::GuideParameters;
    nb::class_<GuideParameters>(m, "GuideParameters", "How a guide holds the tip, SI")
        .def(nb::init<double, double, vfplan::Ends, vfplan::Hold, bool, std::optional<vfplan::Vec3>,
                      double, double, double>(),
             nb::kw_only(), "radius"_a, "stiffness"_a, "ends"_a, "hold"_a, "cut_bends"_a,
             "ignore_axis"_a.none(), "lead_force"_a, "lead_speed"_a, "period"_a);
    nb::class_<Guide>(m, "Guide")
        .def(
            "__init__",
            [](Guide* self, const Rows& points, const std::vector<std::size_t>& counts,
               const std::vector<bool>& closed, const GuideParameters& p) {
                nb::gil_scoped_release release;
                new (self) Guide(points.data(), counts, closed, p);
            },
            "points"_a, "counts"_a, "closed"_a, "parameters"_a)
        .def(
            "__init__",
            [](Guide* self, const Rows& vertices, const Numbers& bulges, const Ids& stroke,
               const Flags& closed, const GuideParameters& p) {
                new (self) Guide(strokes(vertices, bulges, stroke, closed), p);
            },
            "vertices"_a, "bulges"_a, "stroke"_a, "closed"_a, "parameters"_a)
        .def("reset", &reset<Guide>, "hip"_a)
        .def("run", &run<Guide>, "hips"_a)
        .def("at", &at, "strand"_a, "arcs"_a)
        .def("tight_bend", &tight_bend)
        .def_prop_ro("lengths", [](const Guide& g) {
            std::vector<double> lengths;
            for (const auto& s : g.path().strands()) lengths.push_back(s.length);
            return lengths;
        });

    using vfplan::GovernorLimits;
    m.attr("most_joints") = GovernorLimits::max_joints;
    nb::class_<GovernorLimits>(m, "GovernorLimits", "what an arm takes, SI")
        .def(nb::init<>())
        .def_rw("force_step", &GovernorLimits::force_step)
        .def_rw("force_max", &GovernorLimits::force_max)
        .def_rw("stiffness", &GovernorLimits::stiffness)
        .def_rw("mass", &GovernorLimits::mass)
        .def_rw("period", &GovernorLimits::period)
        .def_rw("torque_step", &GovernorLimits::torque_step)
        .def_rw("torque_max", &GovernorLimits::torque_max)
        .def_prop_ro("least_passive_step", &GovernorLimits::least_passive_step);
    nb::class_<Governor>(m, "Governor")
        .def(nb::init<const GovernorLimits&>())
        .def("reset", alone(&Governor::reset))
        .def("run", &govern, "forces"_a, "jacobians"_a = nb::none())
        .def_prop_ro("energy_given", alone(&Governor::energy_given))
        .def_prop_ro("energy_stored", alone(&Governor::energy_stored));

    nb::class_<MovingFrame>(m, "MovingFrame", "the frame of a tracked fixture")
        .def(
            "__init__",
            [](MovingFrame* self, double age, double speed, double turn, const Vec3& pivot) {
                new (self) MovingFrame({age, speed, turn, pivot});
            },
            "max_age"_a, "max_speed"_a, "max_turn"_a, "pivot"_a)
        .def("pose", [](MovingFrame& f, double stamp,
                        const Matrix& m) { return f.pose(stamp, Pose::of_rows(m.data())); })
        .def("pose",
             [](MovingFrame& f, double stamp, const Vec3& place, const Quaternion& q) {
                 return f.pose(stamp, {place, q(0), {{q(1), q(2), q(3)}}});
             })
        .def("reset", &MovingFrame::reset)
        .def("at",
             [](MovingFrame& f, double t) {
                 auto row = array<double>(1, 7);
                 write(f.at(t), row.data());
                 return row;
             })
        .def("run", &run_in_frame<Engine>)
        .def("run", &run_in_frame<Guide>)
        .def("lag", &MovingFrame::lag)
        .def_prop_ro("stale", &MovingFrame::stale)
        .def_prop_ro("refused", &MovingFrame::refused);
}
