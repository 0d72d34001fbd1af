// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Who vouches for a bundle: trusted keys, and what a controller demands of a signature. The one
// header here that needs a library: OpenSSL's libcrypto (target vfplan::sign).
#pragma once

#include <openssl/evp.h>
#include <openssl/pem.h>

#include <chrono>

#include "vfplan/bundle/fixture.hpp"

namespace vfplan::bundle {

/// A trusted Ed25519 public key.
using PublicKey = std::shared_ptr<EVP_PKEY>;

inline std::array<unsigned char, 16> key_id(const PublicKey& key) {
    std::array<unsigned char, 32> raw{};
    std::size_t length = raw.size();
    const bool is_raw = EVP_PKEY_get_raw_public_key(key.get(), raw.data(), &length) == 1;
    detail::require(is_raw, "signature.key", "", {"has a trusted key that is not Ed25519"},
                    "Trust a key that `vfplan keygen` wrote");
    const Digest digest = sha256(raw);
    std::array<unsigned char, 16> id{};
    std::copy_n(digest.begin(), id.size(), id.begin());
    return id;
}

/// The keys of a file of PEM public keys, one after the other, as `vfplan keygen` writes them.
///
/// Refuses a file that holds anything else but empty lines and comments (#).
inline std::vector<PublicKey> read_keys(const std::filesystem::path& path) {
    constexpr std::size_t max_bytes = 1 << 20;
    constexpr std::string_view blank = " \t\r";
    const Bytes data = read_file(path);
    const auto must = [&](bool good, Sentence wrong) {
        detail::require(good, "input", path.string(), wrong,
                        "Give the public keys that `vfplan keygen` wrote");
    };
    must(data.size() <= max_bytes, {"is too long for a file of keys"});
    std::vector<PublicKey> keys;
    std::string block;
    for (std::string_view line : split(View(data).text(), '\n')) {
        line = line.substr(0, line.find_last_not_of(blank) + 1);
        line.remove_prefix(std::min(line.find_first_not_of(blank), line.size()));
        if (block.empty() && (line.empty() || line[0] == '#')) continue;
        must(!block.empty() || line == "-----BEGIN PUBLIC KEY-----",
             {"holds something that is no public key in PEM form"});
        block.append(line) += '\n';
        if (line != "-----END PUBLIC KEY-----") continue;
        const std::unique_ptr<BIO, int (*)(BIO*)> bio(
            BIO_new_mem_buf(block.data(), static_cast<int>(block.size())), BIO_free);
        PublicKey key(PEM_read_bio_PUBKEY(bio.get(), nullptr, nullptr, nullptr), EVP_PKEY_free);
        must(key != nullptr && EVP_PKEY_base_id(key.get()) == EVP_PKEY_ED25519,
             {"holds a key that cannot be read, or is not Ed25519"});
        keys.push_back(std::move(key));
        block.clear();
    }
    must(block.empty(), {"ends within a public key"});
    must(!keys.empty(), {"holds no public key"});
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

/// Throws "signature..." unless a trusted key signed this seal for this case, robot and time.
inline void require_signature(const Seal& seal, const Trust& trust) {
    detail::require(seal.is_signed, "signature.missing", "", {"is not signed"});
    const auto key = std::ranges::find(trust.keys, seal.key_id, key_id);
    detail::require(key != trust.keys.end(), "signature.key", "",
                    {"is signed by key ", to_hex(seal.key_id), ", which is not trusted"});
    const std::unique_ptr<EVP_MD_CTX, void (*)(EVP_MD_CTX*)> ctx(EVP_MD_CTX_new(), EVP_MD_CTX_free);
    const bool holds =
        ctx != nullptr &&
        EVP_DigestVerifyInit(ctx.get(), nullptr, nullptr, nullptr, key->get()) == 1 &&
        EVP_DigestVerify(ctx.get(), seal.signature.data(), seal.signature.size(),
                         seal.signed_message.data(), seal.signed_message.size()) == 1;
    detail::require(holds, "signature.wrong", "", {"has a signature that does not hold"});
    const auto check_for = [](const std::optional<std::string>& wanted, const std::string& found,
                              const std::string& noun, const char* option) {
        if (!wanted || *wanted == found) return;
        const std::string todo = "Sign it for this " + noun + " with `vfplan sign " + option + "`";
        detail::require(!found.empty(), "signature." + noun, "",
                        {"is signed for no particular ", noun}, todo);
        detail::refuse("signature." + noun, "", {"is signed for another ", noun});
    };
    check_for(trust.case_token, seal.case_token, "case", "--case");
    check_for(trust.robot_serial, seal.robot_serial, "robot", "--robot-serial");
    if (!trust.max_age) return;
    detail::require(seal.signed_at != 0, "signature.age", "",
                    {"does not state when it was signed"});
    const auto now = std::chrono::system_clock::now().time_since_epoch();
    const auto age = std::chrono::duration_cast<std::chrono::seconds>(now) -
                     std::chrono::seconds(static_cast<std::int64_t>(seal.signed_at));
    detail::require(age <= *trust.max_age, "signature.age", "", {"was signed too long ago"});
    detail::require(age >= std::chrono::seconds(-60), "signature.age", "",
                    {"was signed at a time that lies in the future"},
                    "Set the clock of this machine, or sign the bundle again");
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
