// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The Python face of the controller. Python has checked who signed a bundle's bytes.
#include "vfplan/controller.hpp"

#include <nanobind/stl/string.h>

#include "numpy.hpp"

namespace {

namespace vb = vfplan::bundle;

struct Controller : vfplan::Controller {
    using vfplan::Controller::Controller;
    vfplan::Demand demand;
    std::atomic_flag busy = ATOMIC_FLAG_INIT;
};

vb::Fixture fixture_of(const nb::bytes& data, const vfplan::Demand& demand) {
    const vb::View bytes{reinterpret_cast<const unsigned char*>(data.c_str()), data.size()};
    nb::gil_scoped_release release;
    vb::Fixture fixture = vb::to_fixture(vb::read_bundle(bytes));
    vfplan::detail::check(fixture, demand);
    return fixture;
}

nb::tuple answer(const vfplan::Command& c) {
    auto rows = array<double>(4, 3);
    const vfplan::Vec3* from[] = {&c.force, &c.rendered, &c.proxy, &c.normal};
    for (int i = 0; i < 4; ++i) std::memcpy(rows.data() + 3 * i, from[i]->c, sizeof from[i]->c);
    return nb::make_tuple(rows, int(c.state), int(c.status), int(c.governor), int(c.stopping),
                          c.stop);
}

nb::tuple step(Controller& c, const vfplan::Vec3& tip, std::optional<double> time,
               const std::optional<Jacobian>& jacobian) {
    const ExclusiveUse turn(c.busy, "Controller", "controller");
    if (!jacobian) return answer(c.step(tip, time));
    return answer(c.step(tip, time, jacobian->data(), int(jacobian->shape(1))));
}

}  // namespace

void bind_controller(nb::module_& m) {
    const vfplan::ControllerSettings usual;
    nb::class_<Controller>(m, "Controller", "fixtures, moving frame and governor behind one step")
        .def(
            "__init__",
            [](Controller* self, const nb::bytes& data, bool accept_unreviewed, bool accept_doubts,
               const std::optional<std::string>& tool, const vfplan::GovernorLimits& governor,
               double max_hip_step, double hold_time, double max_stiffness,
               const std::optional<vfplan::Vec3>& moving) {
                const vfplan::Demand demand{.tool = tool,
                                            .accept_unreviewed = accept_unreviewed,
                                            .accept_doubts = accept_doubts};
                vfplan::ControllerSettings settings{.governor = governor,
                                                    .max_stiffness = max_stiffness,
                                                    .max_hip_step = max_hip_step,
                                                    .hold_time = hold_time};
                if (moving) settings.moving = {(*moving)[0], (*moving)[1], (*moving)[2], {}};
                new (self) Controller(fixture_of(data, demand), demand, settings);
                self->demand = demand;
            },
            "data"_a, nb::kw_only(), "accept_unreviewed"_a, "accept_doubts"_a, "tool"_a.none(),
            "governor"_a, "max_hip_step"_a = usual.max_hip_step, "hold_time"_a = usual.hold_time,
            "max_stiffness"_a = usual.max_stiffness, "moving"_a = nb::none())
        .def("add", [](Controller& c, const nb::bytes& data) { c.add(fixture_of(data, c.demand)); })
        .def("exchange",
             [](Controller& c, const nb::bytes& data, std::size_t which) {
                 return c.exchange(fixture_of(data, c.demand), which);
             })
        .def("reset", &Controller::reset)
        .def("step", &step, "tip"_a, "time_s"_a.none(), "jacobian"_a.none())
        .def("pose",
             [](Controller& c, double stamp, const Matrix& matrix) {
                 return c.pose(stamp, vfplan::Pose::of_rows(matrix.data()));
             })
        .def("torque",
             [](const Controller& c, std::size_t joints) {
                 auto torque = array<double>(joints, 1);
                 std::copy_n(c.torque(), joints, torque.data());
                 return torque;
             })
        .def("request_stop", &Controller::request_stop)
        .def("set_stiffness", &Controller::set_stiffness, "stiffness"_a, "which"_a)
        .def_prop_ro("stiffness", &Controller::stiffness)
        .def_prop_ro("contact_radius", [](const Controller& c) { return c.contact_radius(); })
        .def_prop_ro("rule", [](const Controller& c) { return c.rule(); })
        .def_prop_ro("size", &Controller::size);
}
