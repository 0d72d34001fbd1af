// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The Python face of the governor. No logic here.
#include "ticks.hpp"

namespace {

using Joints = nb::ndarray<const double, nb::shape<vfplan::GovernorLimits::max_joints>,
                           nb::c_contig, nb::device::cpu>;
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

}  // namespace

void bind_governor(nb::module_& m) {
    using vfplan::GovernorLimits;
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
        .def_prop_ro("least_passive_step", &GovernorLimits::least_passive_step);
    nb::class_<Governor>(m, "Governor")
        .def(nb::init<const GovernorLimits&>())
        .def("reset", alone(&Governor::reset))
        .def("run", &govern, "forces"_a, "jacobians"_a = nb::none())
        .def_prop_ro("energy_given", alone(&Governor::energy_given))
        .def_prop_ro("energy_stored", alone(&Governor::energy_stored));
}
