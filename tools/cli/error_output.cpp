// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "error_output.h"

#include <cctype>
#include <cstdio>
#include <new>
#include <nlohmann/json.hpp>
#include <string_view>
#include <system_error>
#include <utility>

#include "json_text.h"

namespace accessvdb::tools {
namespace {

constexpr std::size_t kMaxTextBytes = 1024;

void printLine(const std::string& line) { std::fprintf(stderr, "%s\n", line.c_str()); }

std::string jsonLine(const nlohmann::ordered_json& value) { return jsonText(value, -1); }

/// Names of the library's parameters and values, and the program's flags for them.
constexpr std::pair<std::string_view, std::string_view> kFlagOf[] = {{"voxel_size_m", "--voxel"},
                                                                     {"range_noise_m", "--range-noise"},
                                                                     {"truncation_distance_m", "--tau"},
                                                                     {"min_range_m", "--min-range"},
                                                                     {"max_range_m", "--max-range"},
                                                                     {"num_directions", "--directions"},
                                                                     {"rolls", "--rolls"},
                                                                     {"corridor_length_m", "--corridor"},
                                                                     {"max_collisions", "--max-collisions"},
                                                                     {"neighbours", "--knn"},
                                                                     {"threads", "--threads"},
                                                                     {"origin_W", "--origin"},
                                                                     {"origins_W", "--sensor-at"},
                                                                     {"free_for_s", "--free-for"},
                                                                     {"ChangeMode::Off", "--change off"},
                                                                     {"ChangeMode::Block", "--change block"},
                                                                     {"ChangeMode::Full", "--change full"},
                                                                     {"UpdatePolicy::Exact", "--policy exact"},
                                                                     {"UpdatePolicy::Paper", "--policy paper"}};

bool isNamePart(char c) { return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_' || c == ':' || c == '-'; }

/// The text with the library's names replaced, where they are whole words.
/// @param is_name  all of it is a name; else "rolls", "threads" and "neighbours" are only words
std::string inFlags(std::string text, bool is_name) {
  for (const auto& [name, flag] : kFlagOf) {
    if (!is_name && name.find_first_of("_:") == std::string_view::npos) continue;
    for (std::size_t at = 0; (at = text.find(name, at)) != std::string::npos;) {
      const std::size_t end = at + name.size();
      const bool whole = (at == 0 || !isNamePart(text[at - 1])) && (end == text.size() || !isNamePart(text[end]));
      if (whole) text.replace(at, name.size(), flag);
      at += whole ? flag.size() : name.size();
    }
  }
  return text;
}

/// Problems are left as they are: those of states and plans list parameters by the names that files have them by.
Failure inFlags(const Error& error) {
  const bool is_name = error.code() == ErrorCode::Usage;
  return {error.exitCode(), error.id(), is_name ? inFlags(error.subject(), true) : error.subject(), error.problem(),
          inFlags(error.advice(), false)};
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
    return inFlags(*ours);
  }
  // std::thread and TBB say it in their own ways.
  const auto* system = dynamic_cast<const std::system_error*>(&error);
  if ((system != nullptr && system->code() == std::errc::resource_unavailable_try_again) ||
      std::string_view(error.what()).find("pthread_create") != std::string_view::npos) {
    return {static_cast<int>(ErrorCode::Resource), "limit.threads", "threads", "no more threads can be started",
            "Raise the limit on processes (ulimit -u, or that of the container), or end other programs"};
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
