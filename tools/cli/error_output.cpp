// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "error_output.h"

#include <cstdio>
#include <new>
#include <nlohmann/json.hpp>

namespace accessvdb::tools {
namespace {

constexpr std::size_t kMaxTextBytes = 1024;

void printLine(const std::string& line) { std::fprintf(stderr, "%s\n", line.c_str()); }

std::string jsonLine(const nlohmann::ordered_json& value) {
  return value.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

std::string sentence(const std::string& text) { return text.empty() || text.back() == '.' ? text : text + "."; }

}  // namespace

std::string printable(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (out.size() >= kMaxTextBytes) return out + "...";
    const auto byte = static_cast<unsigned char>(c);
    if (byte >= 0x20 && byte != 0x7f) {
      out += c;
    } else {
      char escaped[8];
      std::snprintf(escaped, sizeof escaped, "\\x%02x", byte);
      out += escaped;
    }
  }
  return out;
}

Failure describeFailure(const std::exception& error) {
  if (const auto* ours = dynamic_cast<const Error*>(&error)) {
    return {ours->exitCode(), ours->id(), ours->subject(), ours->problem(), ours->advice()};
  }
  if (dynamic_cast<const std::bad_alloc*>(&error)) {
    return {static_cast<int>(ErrorCode::Resource), "limit.allocation", "memory", "the machine has run out of memory",
            "Use a larger --voxel, fewer scans (--every) or a machine with more memory"};
  }
  return {static_cast<int>(ErrorCode::Internal), "internal.exception", "", error.what(),
          "This is a bug: please report it with this line and the command"};
}

void Messages::error(const Failure& failure) const {
  if (format_ == ErrorFormat::Json) {
    printLine(jsonLine({{"level", "error"},
                        {"id", failure.id},
                        {"exit_code", failure.exit_code},
                        {"subject", printable(failure.subject)},
                        {"problem", printable(failure.problem)},
                        {"advice", printable(failure.advice)}}));
    return;
  }
  std::string line = "accessvdb: error[" + failure.id + "] ";
  if (!failure.subject.empty()) line += printable(failure.subject) + ": ";
  line += sentence(printable(failure.problem));
  if (!failure.advice.empty()) line.append(" ").append(sentence(printable(failure.advice)));
  printLine(line);
}

void Messages::warning(const std::string& id, const std::string& text) {
  warnings_.emplace_back(id, text);
  if (format_ == ErrorFormat::Json) {
    printLine(jsonLine({{"level", "warning"}, {"id", id}, {"text", printable(text)}}));
  } else {
    printLine("accessvdb: warning[" + id + "] " + sentence(printable(text)));
  }
}

void Messages::notice(const std::string& text) {
  notices_.push_back(text);
  progress(text);
}

void Messages::progress(const std::string& text) const {
  if (quiet_) return;
  if (format_ == ErrorFormat::Json) {
    printLine(jsonLine({{"level", "notice"}, {"text", printable(text)}}));
  } else {
    printLine("accessvdb: " + printable(text));
  }
}

}  // namespace accessvdb::tools
