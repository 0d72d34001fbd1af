// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The names the reader had when it needed libhdf5; vfplan/bundle/fixture.hpp is the reader.
#pragma once

#include "vfplan/bundle/fixture.hpp"
#if __has_include(<openssl/evp.h>)
#include "vfplan/bundle/trust.hpp"
#endif

namespace vfplan::inline v1 {
namespace hdf5 = bundle;
}
