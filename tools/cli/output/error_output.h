// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Everything that goes to stderr, in one place: errors and warnings, one line each, as text or JSON.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/error.h"

namespace accessvdb::tools {

enum class ErrorFormat { Text, Json };

/// An Error as data, so that it can be printed, reported and returned after the exception is gone.
struct Failure {
  int exit_code = 0;
  std::string id, subject, problem, advice;
};

/// Converts any exception: library errors unchanged, out of memory as code 5, anything else as code 70.
[[nodiscard]] Failure describeFailure(const std::exception& error);

/// Escapes control bytes and bounds the length, so that text from a file cannot spoof or flood the terminal.
[[nodiscard]] std::string printable(const std::string& text);

class Messages {
 public:
  Messages(ErrorFormat format, bool quiet) : format_(format), quiet_(quiet) {}

  void error(const Failure& failure) const;
  void warning(const std::string& id, const std::string& text);
  /// Printed unless --quiet.
  void notice(const std::string& text);
  /// The same, but forgotten: for runs that go on for days.
  void progress(const std::string& text) const;

  [[nodiscard]] bool quiet() const { return quiet_; }
  void setQuiet(bool quiet) { quiet_ = quiet; }
  [[nodiscard]] ErrorFormat format() const { return format_; }
  /// For report.json: warnings as id and text, notices as text, in the order in which they were printed.
  [[nodiscard]] const std::vector<std::pair<std::string, std::string>>& warnings() const { return warnings_; }
  [[nodiscard]] const std::vector<std::string>& notices() const { return notices_; }

 private:
  ErrorFormat format_;
  bool quiet_;
  std::vector<std::pair<std::string, std::string>> warnings_;
  std::vector<std::string> notices_;
};

}  // namespace accessvdb::tools
