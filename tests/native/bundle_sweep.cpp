// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// The C++ reader against damaged files, many in one process:
//
//   bundle_sweep verdicts            paths on stdin; for each a line "KIND where" or "ok"
//   bundle_sweep stream              bundles on stdin, each behind its length in 4 bytes
//   bundle_sweep forgeries FILE KEYS one bit of every byte, with all digests made anew, and signed?
//   bundle_sweep verify FILE KEYS CASE SERIAL MAX_AGE_S     prints "ok", or the code
//   bundle_sweep flips FILE FIRST STEP [reseal]     one bit of every STEP-th byte
//   bundle_sweep prefixes FILE FIRST STEP [reseal]  every STEP-th length
//
// The sweeps print one character a case: '.' refused, '=' read with the same values, '!' read with
// others. A crash shows in the exit status.
#include <cstring>
#include <iostream>
#include <string>

#include "vfplan/bundle/hdf5.hpp"
#include "vfplan/bundle/trust.hpp"

namespace {

using vfplan::bundle::Bytes;

using vfplan::bundle::View;

// The tests' files have a seal of 512 bytes.
constexpr std::size_t seal_size = 512, tail_size = 48;

void put_digest(Bytes& data, std::size_t first, std::size_t count, std::size_t at) {
    const auto digest = vfplan::bundle::sha256(View(data).part(first, count));
    std::copy(digest.begin(), digest.end(), data.begin() + std::ptrdiff_t(at));
}

/// The digests of the seal are made anew; that of the payload not where the seal itself is damaged.
void reseal(Bytes& data, bool damaged_seal) {
    const std::size_t payload = data.size() - seal_size;
    if (!damaged_seal) put_digest(data, 0, payload, payload + 24);
    put_digest(data, payload, seal_size - tail_size, data.size() - tail_size);
}

/// The first bytes of a bundle, filled up to a multiple of 8, under the seal of the whole one with
/// all its lengths and digests made anew.
Bytes sealed_prefix(const Bytes& good, std::size_t length) {
    Bytes data(good.begin(), good.begin() + std::ptrdiff_t(length));
    data.resize((length + 7) / 8 * 8);
    const std::uint64_t payload = data.size(), end = payload + seal_size;
    if (payload >= 48) {
        std::memcpy(data.data() + 28, &end, sizeof end);
        const std::uint32_t sum = vfplan::bundle::detail::lookup3(View(data).first(44));
        std::memcpy(data.data() + 44, &sum, sizeof sum);
    }
    data.insert(data.end(), good.end() - std::ptrdiff_t(seal_size), good.end());
    std::memcpy(data.data() + payload + 16, &payload, sizeof payload);
    reseal(data, false);
    return data;
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

/// The bundles come one after the other; one character each.
int stream() {
    std::uint32_t length = 0;
    while (std::cin.read(reinterpret_cast<char*>(&length), sizeof length)) {
        Bytes data(length);
        std::cin.read(reinterpret_cast<char*>(data.data()), std::streamsize(length));
        char found = '=';
        try {
            vfplan::bundle::read_bundle(data);
        } catch (const vfplan::bundle::BundleError&) {
            found = '.';
        }
        // The list of all findings has errors where the reader refuses.
        const auto all = vfplan::bundle::examine(data);
        const bool sound =
            std::none_of(all.begin(), all.end(), [](const auto& f) { return f.error; });
        std::cout << (sound == (found == '=') ? found : '!');
    }
    std::cout << std::endl;
    return 0;
}

/// Whoever changes a signed file and makes its digests anew has no signature.
int forgeries(const std::string& path, const std::string& keys) {
    const vfplan::bundle::Trust trust{vfplan::bundle::read_keys(keys)};
    const Bytes good = vfplan::bundle::read_file(path);
    vfplan::bundle::read_bundle(good, trust);
    for (std::size_t i = 0; i < 2 * good.size(); ++i) {
        Bytes data = good;
        const std::size_t at = i / 2;
        data[at] ^= static_cast<unsigned char>(1u << (at % 8));
        if (i % 2 != 0) reseal(data, at >= good.size() - seal_size);
        try {
            vfplan::bundle::read_bundle(data, trust);
            std::cout << (data == good ? '=' : '!');
        } catch (const vfplan::bundle::BundleError&) {
            std::cout << '.';
        }
    }
    std::cout << std::endl;
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
    if (mode == "stream") return stream();
    if (mode == "forgeries" && argc == 4) return forgeries(argv[2], argv[3]);
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
            if (again) reseal(data, i >= good.size() - seal_size);
        } else if (again) {
            data = sealed_prefix(good, i);
        } else {
            data.resize(i);
        }
        std::cout << verdict(std::move(data), wanted) << std::flush;
    }
    std::cout << std::endl;
    return 0;
}
