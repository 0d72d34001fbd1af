// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
#pragma once

#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>

namespace vfplan::hdf5 {

/// A bundle that cannot be trusted, or a file that cannot be read.
///
/// `code` begins with "input" (no such file), "corrupt", "unsafe", "version" or "signature" and
/// is the code that `vfplan validate` prints; `where` is the path inside the bundle, or empty.
class BundleError : public std::runtime_error {
  public:
    BundleError(std::string code, std::string where, const std::string& message)
        : std::runtime_error(where.empty() ? message : where + ": " + message),
          code(std::move(code)),
          where(std::move(where)) {}

    /// The name of the Python exception for the same finding.
    [[nodiscard]] std::string_view kind() const {
        const std::string_view head = std::string_view(code).substr(0, code.find('.'));
        if (head == "input") return "InputError";
        if (head == "unsafe") return "UnsafeError";
        if (head == "version") return "VersionError";
        if (head == "signature") return "SignatureError";
        return "CorruptError";
    }

    std::string code;
    std::string where;
};

namespace detail {

[[noreturn]] inline void refuse(const char* code, std::string_view where,
                                const std::string& message) {
    throw BundleError(code, std::string(where), message);
}

}  // namespace detail

}  // namespace vfplan::hdf5
