// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "options/command_line.h"

#include <toml++/toml.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <optional>
#include <sstream>

#include "accessvdb/config.h"
#include "accessvdb/error.h"

namespace accessvdb::tools {
namespace {

namespace fs = std::filesystem;

/// More than any configuration of ours has. The parser's tables nest as deep as keys have parts, and it walks them
/// recursively; there is at most one part for each dot, and for each of the arrays and tables that it counts itself.
constexpr std::size_t kMostConfigBytes = std::size_t{1} << 20;
constexpr std::ptrdiff_t kMostConfigDots = 10'000;

constexpr const char* kVerbs[] = {"map",      "tile",   "live",   "advise",     "consistency", "evaluate",
                                  "simulate", "bench",  "info",   "query",      "diff",        "render",
                                  "report",   "whatif", "export", "approaches", "views"};

/// A TOML value as the text that would follow the flag; [1, 2, 3] becomes 1,2,3.
/// @param between  of the elements of an array
std::optional<std::string> flagText(const toml::node& node, const std::string& between = ",") {
  if (const auto* text = node.as_string()) return text->get();
  if (const auto* array = node.as_array()) {
    std::string joined;
    for (const toml::node& element : *array) {
      const auto part = flagText(element);
      if (!part || part->empty()) return part;
      joined += (joined.empty() ? std::string() : between) + *part;
    }
    return joined;
  }
  if (!node.is_integer() && !node.is_floating_point() && !node.is_boolean()) return std::nullopt;
  std::ostringstream out;
  out.imbue(std::locale::classic());
  out.precision(17);
  if (const auto* integer = node.as_integer()) out << integer->get();
  if (const auto* real = node.as_floating_point()) out << real->get();
  if (const auto* boolean = node.as_boolean()) out << (boolean->get() ? "true" : "false");
  return out.str();
}

/// Whether an array is one tip, axis or up of a tool, not one text for each of several tools.
bool isOneVector(const std::string& key, const toml::node& node) {
  const auto* array = node.as_array();
  const bool numbers = array != nullptr && !array->empty() && array->front().is_number();
  return numbers && (key == "tool-tip" || key == "tool-axis" || key == "tool-up");
}

/// Flags that say what to do with a configuration are no part of one.
bool belongsInConfig(const std::string& key) { return key != "config" && key != "print-config" && key != "help"; }

void applyTable(FlagParser& flags, const std::string& file, const toml::table& table, bool strict) {
  for (const auto& [toml_key, node] : table) {
    const std::string key(toml_key.str());
    if (node.is_table()) {
      if (std::find(std::begin(kVerbs), std::end(kVerbs), key) == std::end(kVerbs) || strict) {
        throw InvalidArgument("config.table", file, "[" + key + "] is not a verb", "Use [" + flags.verb() + "]");
      }
      continue;
    }
    if (!belongsInConfig(key) || !flags.has(key)) {
      throw InvalidArgument("config.key", file, "\"" + key + "\" is not an option of " + flags.command(),
                            "Keys are the flags without the dashes; see " + flags.command() + " --help");
    }
    if (flags.isSet(key)) continue;  // a flag wins over any key, a key of [verb] over a top-level one
    const auto text =
        flagText(node, flags.repeats(key) && !isOneVector(key, node) ? std::string(1, kBetweenValues) : ",");
    if (!text) throw InvalidArgument("config.value", file, "\"" + key + "\" has a value of the wrong kind");
    if (text->empty()) {
      throw InvalidArgument("config.value", file, "\"" + key + "\" is empty", "Give it a value, or leave it out");
    }
    if (const auto problem = flags.set(key, *text)) {
      throw InvalidArgument("config.value", file, "\"" + key + "\": " + *problem);
    }
  }
}

void applyConfig(FlagParser& flags, const std::string& file) {
  std::error_code status;
  if (fs::is_other(fs::status(file, status))) {  // opening a pipe could block for ever
    throw InputError("input.not_a_file", file, "is not a regular file", "Use the path of a regular file");
  }
  std::ifstream in(file);
  if (in.is_open() && in.peek() == std::ifstream::traits_type::eof() && in.bad()) errno = EISDIR;
  if (!in.is_open() || in.bad()) {
    throw InputError("config.unreadable", file, std::string("cannot be read: ") + std::strerror(errno),
                     "Check the path");
  }
  std::string text(kMostConfigBytes + 1, '\0');
  in.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(in.gcount()));
  if (text.size() > kMostConfigBytes || std::count(text.begin(), text.end(), '.') > kMostConfigDots) {
    throw InvalidArgument("config.size", file, "is larger than 1 MiB, or has more than 10000 dots",
                          "A configuration has one short line for each flag; --print-config writes one");
  }
  toml::table table;
  try {
    table = toml::parse(text, file);
  } catch (const toml::parse_error& error) {
    std::ostringstream problem;
    problem << "line " << error.source().begin.line << " is not TOML: " << error.description();
    throw InvalidArgument("config.syntax", file, problem.str(), "Write key = value, with text in quotes");
  }
  if (const toml::table* own = table[flags.verb()].as_table()) applyTable(flags, file, *own, true);
  applyTable(flags, file, table, false);
}

}  // namespace

void addCommonOptions(FlagParser& flags, CommonOptions& options) {
  flags.option("--device", &options.device, "where scoring runs: auto, cpu or cuda");
  flags.option("--threads", &options.threads, "threads to use; 0 = all");
  flags.option("--config", &options.config, "TOML file with the same names as the flags; flags take precedence");
  flags.flag("--quiet", options.quiet, "only errors and warnings on stderr");
  flags.option("--error-format", &options.error_format, "how stderr is written: text or json");
}

bool parseCommandLine(FlagParser& flags, const Arguments& arguments, const CommonOptions& options, Messages& messages) {
  if (!flags.parse(arguments)) {
    printData(flags.help());
    return false;
  }
  if (!options.config.empty()) applyConfig(flags, options.config);
  messages.setQuiet(options.quiet);
  return true;
}

void checkCommonOptions(const CommonOptions& options) {
  if (options.device != "auto" && options.device != "cpu" && options.device != "cuda") {
    throw InvalidArgument("usage.device", "--device", "\"" + options.device + "\" is not a device",
                          "Use auto, cpu or cuda");
  }
  if (options.threads < 0 || options.threads > 4096) {
    throw InvalidArgument("usage.threads", "--threads", "must be in 0 .. 4096", "Use 0 for all");
  }
  if (options.error_format != "text" && options.error_format != "json") {
    throw InvalidArgument("usage.error_format", "--error-format", "\"" + options.error_format + "\" is not a format",
                          "Use text or json");
  }
#ifndef ACCESSVDB_HAS_CUDA
  if (options.device == "cuda") {
    throw DeviceError("device.not_built", "cuda", "this program was built without CUDA", "Use --device auto or cpu");
  }
#endif
}

namespace {

void insertValue(toml::table& values, const std::string& key, const std::string& text) {
  std::int64_t integer = 0;
  double real = 0;
  const char* end = text.data() + text.size();
  if (auto parsed = std::from_chars(text.data(), end, integer); parsed.ec == std::errc() && parsed.ptr == end) {
    values.insert(key, integer);
  } else if (auto number = std::from_chars(text.data(), end, real); number.ec == std::errc() && number.ptr == end) {
    values.insert(key, real);
  } else {
    values.insert(key, text);
  }
}

}  // namespace

std::string configEntry(const std::string& key, const std::string& text) {
  if (text == "true" || text == "false") return key + " = " + text + "\n";
  double number = 0;
  const char* end = text.data() + text.size();
  if (auto parsed = std::from_chars(text.data(), end, number); parsed.ec == std::errc() && parsed.ptr == end) {
    char shortest[40];
    return key + " = " + std::string(shortest, std::to_chars(shortest, shortest + sizeof shortest, number).ptr) + "\n";
  }
  toml::table values;
  values.insert(key, text);
  std::ostringstream out;
  out << values << "\n";
  return out.str();
}

std::string effectiveConfig(const FlagParser& flags) {
  toml::table values;
  for (const auto& [key, value] : flags.settings()) {
    if (!belongsInConfig(key)) continue;
    if (const bool* on = std::get_if<bool>(&value)) {
      values.insert(key, *on);
      continue;
    }
    const std::string& text = std::get<std::string>(value);
    if (text.empty()) continue;
    if (flags.repeats(key) && text.find(kBetweenValues) != std::string::npos) {
      toml::array each;
      std::istringstream lines(text);
      for (std::string line; std::getline(lines, line, kBetweenValues);) each.push_back(line);
      values.insert(key, each);
    } else {
      insertValue(values, key, text);
    }
  }
  std::ostringstream out;
  out << "[" << flags.verb() << "]\n" << values << "\n";
  return out.str();
}

void printData(const std::string& text) {
  const bool written = std::fwrite(text.data(), 1, text.size(), stdout) == text.size();
  if (!written || std::fflush(stdout) != 0) {
    throw OutputError("output.stdout", "standard output", std::string("cannot be written: ") + std::strerror(errno),
                      "Free some space or write elsewhere");
  }
}

}  // namespace accessvdb::tools
