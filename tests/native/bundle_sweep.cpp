// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The C++ reader against damaged files, many in one process:
//
//   bundle_sweep verdicts            paths on stdin; for each a line "KIND where" or "ok"
//   bundle_sweep verify FILE KEYS CASE SERIAL MAX_AGE_S     prints "ok", or the code
//   bundle_sweep flips FILE FIRST STEP [reseal]     one bit of every STEP-th byte
//   bundle_sweep prefixes FILE FIRST STEP [reseal]  every STEP-th length
//
// The sweeps print one character a case: '.' refused, '=' read with the same values, '!' read with
// others. A crash shows in the exit status.
#include <cstring>
#include <iostream>
#include <string>

#include "vfplan/bundle/trust.hpp"

namespace {

using vfplan::bundle::Bytes;

// The tests' files have a block of 512 bytes.
constexpr std::size_t block = 512, digest_size = 32;

void reseal(Bytes& data, bool damaged_block) {
    if (data.size() < block) return;
    if (!damaged_block) {
        const std::uint64_t length = data.size() - block;
        std::memcpy(data.data() + 16, &length, sizeof length);
        const auto digest = vfplan::bundle::sha256(vfplan::bundle::View(data).from(block));
        std::copy(digest.begin(), digest.end(), data.begin() + 24);
    }
    const auto digest =
        vfplan::bundle::sha256(vfplan::bundle::View(data).first(block - digest_size));
    std::copy(digest.begin(), digest.end(), data.begin() + block - digest_size);
}

char verdict(Bytes data, const vfplan::bundle::Content& wanted) {
    try {
        return vfplan::bundle::read_bundle(data).content == wanted ? '=' : '!';
    } catch (const vfplan::bundle::BundleError&) {
        return '.';
    }
}

int verdicts() {
    for (std::string path; std::getline(std::cin, path);) {
        try {
            Bytes data = vfplan::bundle::read_file(path);
            vfplan::bundle::read_bundle(data);
            std::cout << "ok" << std::endl;
        } catch (const vfplan::bundle::BundleError& error) {
            std::cout << error.kind() << " " << error.where << std::endl;
        }
    }
    return 0;
}

int verify(const std::string& path, char** words) {
    try {
        const vfplan::bundle::Trust trust{vfplan::bundle::read_keys(words[0]), words[1], words[2],
                                          std::chrono::seconds(std::stol(words[3]))};
        vfplan::bundle::read_fixture(path, trust);
        std::cout << "ok" << std::endl;
    } catch (const vfplan::bundle::BundleError& error) {
        std::cout << error.code << std::endl;
    }
    return 0;
}

}  // namespace

int main(int argc, char** argv) {
    const std::string mode = argc > 1 ? argv[1] : "";
    if (mode == "verdicts") return verdicts();
    if (argc < 5) return 2;
    if (mode == "verify") return argc == 7 ? verify(argv[2], argv + 3) : 2;
    const Bytes good = vfplan::bundle::read_file(argv[2]);
    Bytes copy = good;
    const auto wanted = vfplan::bundle::read_bundle(copy).content;
    const bool again = argc > 5;
    for (std::size_t i = std::stoul(argv[3]); i < good.size(); i += std::stoul(argv[4])) {
        Bytes data = good;
        if (mode == "flips") {
            data[i] ^= static_cast<unsigned char>(1u << (i % 8));
        } else {
            data.resize(i);
        }
        if (again) reseal(data, mode == "flips" && i < block);
        std::cout << verdict(std::move(data), wanted) << std::flush;
    }
    std::cout << std::endl;
    return 0;
}
