// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
#pragma once

#include "vfplan/tick_time.hpp"
