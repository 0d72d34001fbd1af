// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// libFuzzer's target for the bundle reader, behind seal and checksums; run by tests/native/fuzz.sh.
// Only BundleError may come out, and the strict reader refuses what the collecting one finds.
#include <cstdlib>

#include "vfplan/bundle/fixture.hpp"

namespace vb = vfplan::bundle;

extern "C" int LLVMFuzzerTestOneInput(const unsigned char* data, std::size_t size) {
    const vb::View payload(data, size);
    for (const bool sealed : {true, false}) {
        vb::Findings all(false), first(true);
        vb::read_payload(payload, all, sealed);
        bool read = true;
        try {
            vb::read_payload(payload, first, sealed);
        } catch (const vb::BundleError&) {
            read = false;
        }
        if (read != all.sound()) std::abort();
    }
    try {
        vb::View inside;
        vb::unseal(payload, inside);
    } catch (const vb::BundleError&) {
    }
    return 0;
}
