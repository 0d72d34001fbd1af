// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The Python face of the governor. No logic here.
#include "vfplan/governor.hpp"

#include "numpy.hpp"

namespace {

using Joints = nb::ndarray<const double, nb::shape<vfplan::GovernorLimits::max_joints>,
                           nb::c_contig, nb::device::cpu>;
using Jacobians = nb::ndarray<const double, nb::shape<-1, 3, -1>, nb::c_contig, nb::device::cpu>;

nb::tuple answer(const vfplan::Governed& g) {
    auto force = array<double>(1, 3);
    std::memcpy(force.data(), g.force.c, sizeof g.force.c);
    return nb::make_tuple(force, g.held_back, static_cast<int>(g.status));
}

// Force (T, 3), torque (T, n), what was held back and status (T,).
nb::tuple govern(vfplan::Governor& governor, const Rows& forces,
                 const std::optional<Jacobians>& jacobians) {
    const std::size_t n = forces.shape(0);
    auto force = array<double>(n, 3), held = array<double>(n, 1);
    auto status = array<std::uint8_t>(n, 1);
    const std::size_t joints = jacobians ? jacobians->shape(2) : 0;
    auto torque = array<double>(n, joints);
    for (std::size_t i = 0; i < n; ++i) {
        const double* f = forces.data() + 3 * i;
        const vfplan::Vec3 asked{{f[0], f[1], f[2]}};
        const vfplan::Governed g =
            jacobians ? governor.step(asked, jacobians->data() + 3 * joints * i, int(joints))
                      : governor.step(asked);
        std::memcpy(force.data() + 3 * i, g.force.c, sizeof g.force.c);
        std::copy_n(governor.torque(), joints, torque.data() + joints * i);
        held.data()[i] = g.held_back;
        status.data()[i] = g.status;
    }
    return nb::make_tuple(force, torque, held, status);
}

}  // namespace

void bind_governor(nb::module_& m) {
    using vfplan::Governor, vfplan::GovernorLimits;
    m.attr("most_joints") = GovernorLimits::max_joints;
    nb::class_<GovernorLimits>(m, "GovernorLimits", "what an arm takes, SI")
        .def(
            "__init__",
            [](GovernorLimits* self, double force_step, double force_max, double stiffness,
               double mass, double period, const Joints& torque_step, const Joints& torque_max) {
                new (self) GovernorLimits;
                self->force_step = force_step;
                self->force_max = force_max;
                self->stiffness = stiffness;
                self->mass = mass;
                self->period = period;
                std::copy_n(torque_step.data(), GovernorLimits::max_joints, self->torque_step);
                std::copy_n(torque_max.data(), GovernorLimits::max_joints, self->torque_max);
            },
            nb::kw_only(), "force_step"_a, "force_max"_a, "stiffness"_a, "mass"_a, "period"_a,
            "torque_step"_a, "torque_max"_a)
        .def_prop_ro("least_passive_step", &GovernorLimits::least_passive_step)
        .def_prop_ro("least_reversing_step", &GovernorLimits::least_reversing_step);
    nb::class_<Governor>(m, "Governor")
        .def(nb::init<const GovernorLimits&>())
        .def("reset", &Governor::reset)
        .def("step", [](Governor& g, const Row& force) { return answer(g.step(vec(force))); })
        .def("step",
             [](Governor& g, const Row& force, const Jacobian& j) {
                 return answer(g.step(vec(force), j.data(), int(j.shape(1))));
             })
        .def("run", &govern, "forces"_a, "jacobians"_a = nb::none())
        .def("torque",
             [](const Governor& g, int joints) {
                 auto torque = array<double>(1, joints);
                 std::copy_n(g.torque(), joints, torque.data());
                 return torque;
             })
        .def_prop_ro("energy_given", &Governor::energy_given)
        .def_prop_ro("energy_stored", &Governor::energy_stored);
}
