// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The Python face of the native engine: the only file that includes nanobind. No logic here.
#include <nanobind/nanobind.h>

#include "vfplan/version.hpp"

namespace nb = nanobind;

NB_MODULE(_core, m) {
    m.doc() = "vfplan's native proxy engine";
    m.attr("__version__") = VFPLAN_VERSION;
}
