// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The Python face of the moving frame. No logic here.
#include "vfplan/moving.hpp"

#include "ticks.hpp"

namespace {

using Quaternion = nb::ndarray<const double, nb::shape<4>, nb::c_contig, nb::device::cpu>;
using Matrix = nb::ndarray<const double, nb::shape<4, 4>, nb::c_contig, nb::device::cpu>;
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

void bind_moving(nb::module_& m) {
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
