// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// What is wrong with a bundle: thrown at the first when loading, listed in full when validating.
#pragma once

#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace vfplan::bundle {

/// A bundle that cannot be trusted, or a file that cannot be read.
///
/// `code` begins with "input" (no such file), "corrupt", "unsafe", "version" or "signature" and
/// is the code that `vfplan validate` prints; `where` is the path inside the bundle, or the file's
/// name, or empty; `what()` begins with it.
class BundleError : public std::runtime_error {
  public:
    BundleError(std::string code, std::string where, const std::string& message)
        : std::runtime_error(where.empty() ? message : where + ": " + message),
          code(std::move(code)),
          where(std::move(where)),
          message(message) {}

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
    std::string message;
};

namespace detail {

/// Throws a BundleError unless this is `good`.
inline void require(bool good, const char* code, std::string_view where, std::string_view message) {
    if (!good) throw BundleError(code, std::string(where), std::string(message));
}

}  // namespace detail

/// One thing that is wrong with a bundle, or, as a note, was left unchecked.
struct Finding {
    std::string code, where, message;
    bool error = true;
};

/// Collects findings; a strict one throws the first error instead.
class Findings {
  public:
    explicit Findings(bool strict) : strict_(strict) {}

    void add(const BundleError& error) {
        if (strict_) throw error;
        all_.push_back({error.code, error.where, error.message, true});
        ++errors_;
    }
    void error(std::string_view code, std::string_view where, const std::string& message) {
        add(BundleError(std::string(code), std::string(where), message));
    }
    void require(bool good, std::string_view code, std::string_view where,
                 std::string_view message) {
        if (!good) error(code, where, std::string(message));
    }
    void note(std::string_view code, std::string_view where, const std::string& message) {
        all_.push_back({std::string(code), std::string(where), message, false});
    }
    [[nodiscard]] bool sound() const { return errors_ == 0; }
    [[nodiscard]] const std::vector<Finding>& all() const { return all_; }

  private:
    bool strict_;
    std::size_t errors_ = 0;
    std::vector<Finding> all_;
};

}  // namespace vfplan::bundle
