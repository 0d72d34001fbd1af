// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The version of vfplan: the only place where it is written.
#pragma once

#define VFPLAN_VERSION_MAJOR 1
#define VFPLAN_VERSION_MINOR 0
#define VFPLAN_VERSION_PATCH 0
#define VFPLAN_VERSION "1.0.0"
