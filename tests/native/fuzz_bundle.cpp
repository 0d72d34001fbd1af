// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// libFuzzer's target for the bundle reader, behind seal and checksums; run by tests/native/fuzz.sh.
// Only BundleError may come out, and the strict reader refuses what the collecting one finds.
#include <cstdlib>

#include "vfplan/bundle/fixture.hpp"

namespace vb = vfplan::bundle;

extern "C" int LLVMFuzzerTestOneInput(const unsigned char* data, std::size_t size) {
    const vb::View payload(data, size);
    // As if the file were as long as its superblock says, so that what lies behind it is reached.
    const std::uint64_t length = size < 36 ? size : vb::number_at(payload, 28, 8);
    vb::Findings all(false), first(true);
    vb::read_payload(payload, length, all);
    bool read = true;
    try {
        vb::read_payload(payload, length, first);
    } catch (const vb::BundleError&) {
        read = false;
    }
    if (read != all.sound()) std::abort();
    try {
        vb::View inside;
        vb::unseal(payload, inside);
    } catch (const vb::BundleError&) {
    }
    return 0;
}
