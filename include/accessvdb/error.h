// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The one exception family that crosses the library boundary.
///
/// Every error carries what the program needs for one line: a stable dotted id, what it is about (a file, a field, a
/// device), what is wrong, and what to do next. `exitCode()` is the program's exit code for it.
#pragma once

#include <stdexcept>
#include <string>
#include <utility>

#include "accessvdb/export.h"

namespace accessvdb {

/// Kinds of failure; the values are the exit codes of the program.
enum class ErrorCode : int {
  Usage = 2,     ///< a parameter or option is wrong; no input was read
  Input = 3,     ///< an input cannot be read or is malformed
  Unusable = 4,  ///< an input is well formed but cannot be used (no overlap, bad poses, implausible tool)
  Resource = 5,  ///< memory or another limit would be exceeded
  Device = 6,    ///< the requested device is missing or lost
  Output = 7,    ///< an output cannot be written durably
  Internal = 70  ///< a bug in the library
};

class ACCESSVDB_API Error : public std::runtime_error {
 public:
  /// @param id       stable dotted name, for example "input.truncated"
  /// @param subject  the file, option or device that it is about; may be empty
  /// @param problem  what is wrong, one sentence without the final full stop
  /// @param advice   what to do next, one sentence without the final full stop; may be empty
  Error(ErrorCode code, std::string id, std::string subject, std::string problem, std::string advice)
      : std::runtime_error((subject.empty() ? "" : subject + ": ") + problem + "." +
                           (advice.empty() ? "" : " " + advice + ".")),
        code_(code),
        id_(std::move(id)),
        subject_(std::move(subject)),
        problem_(std::move(problem)),
        advice_(std::move(advice)) {}

  [[nodiscard]] ErrorCode code() const noexcept { return code_; }
  [[nodiscard]] int exitCode() const noexcept { return static_cast<int>(code_); }
  [[nodiscard]] const std::string& id() const noexcept { return id_; }
  [[nodiscard]] const std::string& subject() const noexcept { return subject_; }
  [[nodiscard]] const std::string& problem() const noexcept { return problem_; }
  [[nodiscard]] const std::string& advice() const noexcept { return advice_; }

 private:
  ErrorCode code_;
  std::string id_, subject_, problem_, advice_;
};

/// One subclass per kind, so that callers can catch what they can handle.
template <ErrorCode kCode>
class ACCESSVDB_API ErrorOf : public Error {
 public:
  ErrorOf(std::string id, std::string subject, std::string problem, std::string advice = {})
      : Error(kCode, std::move(id), std::move(subject), std::move(problem), std::move(advice)) {}
};

using InvalidArgument = ErrorOf<ErrorCode::Usage>;
using InputError = ErrorOf<ErrorCode::Input>;
using UnusableInput = ErrorOf<ErrorCode::Unusable>;
using ResourceLimit = ErrorOf<ErrorCode::Resource>;
using DeviceError = ErrorOf<ErrorCode::Device>;
using OutputError = ErrorOf<ErrorCode::Output>;
using InternalError = ErrorOf<ErrorCode::Internal>;

}  // namespace accessvdb
