// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Who vouches for a bundle: trusted keys, and what a controller demands of a signature. The one
// header here that needs a library: OpenSSL's libcrypto (target vfplan::sign).
#pragma once

#include <openssl/evp.h>
#include <openssl/pem.h>

#include <chrono>
#include <filesystem>
#include <istream>
#include <sstream>

#include "vfplan/bundle/fixture.hpp"

namespace vfplan::bundle {

/// A trusted Ed25519 public key.
using PublicKey = std::shared_ptr<EVP_PKEY>;

inline std::array<unsigned char, 16> key_id(const PublicKey& key) {
    std::array<unsigned char, 32> raw{};
    std::size_t length = raw.size();
    if (EVP_PKEY_get_raw_public_key(key.get(), raw.data(), &length) != 1) {
        detail::refuse("signature.key", "", {"has a trusted key that is not Ed25519"},
                       "Trust a key that `vfplan keygen` wrote");
    }
    const Digest digest = sha256(view(raw));
    std::array<unsigned char, 16> id{};
    std::copy_n(digest.begin(), id.size(), id.begin());
    return id;
}

namespace detail {

/// The next PEM block of a public key in a file of them, or nothing at its end.
///
/// Nothing but empty lines and comments (#) may stand outside of a block.
inline std::string next_key(std::istream& file, const std::string& where) {
    constexpr std::string_view blank = " \t\r";
    std::string block;
    for (std::string line; std::getline(file, line);) {
        line.erase(line.find_last_not_of(blank) + 1);
        line.erase(0, line.find_first_not_of(blank));
        if (block.empty() && (line.empty() || line[0] == '#')) continue;
        if (block.empty() && line != "-----BEGIN PUBLIC KEY-----") {
            detail::refuse("input", where, {"holds something that is no public key in PEM form"},
                           "Give the public keys that `vfplan keygen` wrote");
        }
        block += line + '\n';
        if (line == "-----END PUBLIC KEY-----") return block;
    }
    if (!block.empty())
        detail::refuse("input", where, {"ends within a public key"}, "Fetch the file again");
    return block;
}

}  // namespace detail

/// The keys of a file of PEM public keys, one after the other, as `vfplan keygen` writes them.
///
/// Refuses a file that holds anything else but empty lines and comments (#).
inline std::vector<PublicKey> read_keys(const std::filesystem::path& path) {
    constexpr std::size_t max_bytes = 1 << 20;
    const Bytes data = read_file(path);
    if (data.size() > max_bytes)
        detail::refuse("input", path.string(), {"is too long for a file of keys"},
                       "Give the public keys that `vfplan keygen` wrote");
    std::istringstream file(std::string(data.begin(), data.end()));
    std::vector<PublicKey> keys;
    for (;;) {
        const std::string block = detail::next_key(file, path.string());
        if (block.empty()) break;
        const std::unique_ptr<BIO, int (*)(BIO*)> bio(
            BIO_new_mem_buf(block.data(), static_cast<int>(block.size())), BIO_free);
        PublicKey key(PEM_read_bio_PUBKEY(bio.get(), nullptr, nullptr, nullptr), EVP_PKEY_free);
        if (key == nullptr) {
            detail::refuse("input", path.string(), {"holds a public key that cannot be read"},
                           "Fetch the file again");
        }
        if (EVP_PKEY_base_id(key.get()) != EVP_PKEY_ED25519) {
            detail::refuse("input", path.string(), {"holds a key that is not Ed25519"},
                           "Give the public keys that `vfplan keygen` wrote");
        }
        keys.push_back(std::move(key));
    }
    if (keys.empty())
        detail::refuse("input", path.string(), {"holds no public key"},
                       "Give the public keys that `vfplan keygen` wrote");
    return keys;
}

/// What a controller demands of a bundle's signature: one of the keys, and each of the rest unless
/// it is std::nullopt, which demands nothing. `Trust{keys}` demands a key only.
struct Trust {
    std::vector<PublicKey> keys = {};
    std::optional<std::string> case_token = std::nullopt;
    std::optional<std::string> robot_serial = std::nullopt;
    std::optional<std::chrono::seconds> max_age = std::nullopt;  // since the signing
};

inline bool signature_holds(const Seal& seal, const PublicKey& key) {
    const std::unique_ptr<EVP_MD_CTX, void (*)(EVP_MD_CTX*)> ctx(EVP_MD_CTX_new(), EVP_MD_CTX_free);
    return ctx != nullptr &&
           EVP_DigestVerifyInit(ctx.get(), nullptr, nullptr, nullptr, key.get()) == 1 &&
           EVP_DigestVerify(ctx.get(), seal.signature.data(), seal.signature.size(),
                            seal.signed_message.data(), seal.signed_message.size()) == 1;
}

/// Throws "signature..." unless a trusted key signed this seal for this case, robot and time.
inline void require_signature(
    const Seal& seal, const Trust& trust,
    std::chrono::system_clock::time_point now = std::chrono::system_clock::now()) {
    if (!seal.is_signed) detail::refuse("signature.missing", "", {"is not signed"});
    const auto key = std::find_if(trust.keys.begin(), trust.keys.end(),
                                  [&](const PublicKey& k) { return key_id(k) == seal.key_id; });
    if (key == trust.keys.end()) {
        detail::refuse("signature.key", "",
                       {"is signed by key ", to_hex(view(seal.key_id)), ", which is not trusted"});
    }
    if (!signature_holds(seal, *key))
        detail::refuse("signature.wrong", "", {"has a signature that does not hold"});
    if (trust.case_token && *trust.case_token != seal.case_token) {
        if (seal.case_token.empty())
            detail::refuse("signature.case", "", {"is signed for no particular case"},
                           "Sign it for this case with `vfplan sign --case`");
        detail::refuse("signature.case", "", {"is signed for another case"});
    }
    if (trust.robot_serial && *trust.robot_serial != seal.robot_serial) {
        if (seal.robot_serial.empty())
            detail::refuse("signature.robot", "", {"is signed for no particular robot"},
                           "Sign it for this robot with `vfplan sign --robot-serial`");
        detail::refuse("signature.robot", "", {"is signed for another robot"});
    }
    if (!trust.max_age) return;
    if (seal.signed_at == 0)
        detail::refuse("signature.age", "", {"does not state when it was signed"});
    const auto age = std::chrono::duration_cast<std::chrono::seconds>(now.time_since_epoch()) -
                     std::chrono::seconds(static_cast<std::int64_t>(seal.signed_at));
    if (age > *trust.max_age) detail::refuse("signature.age", "", {"was signed too long ago"});
    if (age < std::chrono::seconds(-60)) {
        detail::refuse("signature.age", "", {"was signed at a time that lies in the future"},
                       "Set the clock of this machine, or sign the bundle again");
    }
}

/// Checks seal and signature, then the rest as read_bundle(data) does. Throws BundleError.
inline Bundle read_bundle(View data, const Trust& trust) {
    return read_bundle(data, [&](const Seal& seal) { require_signature(seal, trust); });
}

/// Reads a bundle that one of the trusted keys signed for its case and robot, and not long ago.
inline Fixture read_fixture(const std::filesystem::path& path, const Trust& trust) {
    return of_file(path, [&](View data) { return to_fixture(read_bundle(data, trust)); });
}

}  // namespace vfplan::bundle
