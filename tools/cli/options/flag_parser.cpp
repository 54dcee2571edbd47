// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "options/flag_parser.h"

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>

#include "accessvdb/error.h"
#include "options/flag_groups.h"

namespace accessvdb::tools {

namespace {

/// From so many flags on, --help has headings.
constexpr std::size_t kManyFlags = 24;

std::string groupOf(const std::string& name) {
  for (const auto& [group, names] : kFlagsOfGroups) {
    if (names.find(" --" + name + " ") != std::string_view::npos) return std::string(group);
  }
  return std::string(kFlagGroups.back());
}

/// The same text with every release of the parser, of which those after 2.3 break lines elsewhere. With many flags
/// their headings are in the order of kFlagGroups, not in that of the flags.
class Help final : public CLI::Formatter {
 public:
  std::string make_help(const CLI::App* app, std::string name, CLI::AppFormatMode mode) const override {
    std::string text = app->get_description() + "\n" + make_usage(app, std::move(name)) + make_positionals(app);
    if (app->get_options().size() >= kManyFlags) {
      for (const std::string_view group : kFlagGroups) {
        const auto belongs = [&](const CLI::Option* option) {
          return option->nonpositional() && option->get_group() == group;
        };
        const std::vector<const CLI::Option*> options = app->get_options(belongs);
        if (!options.empty()) text += make_group(std::string(group), false, options);
      }
    } else {
      text += make_groups(app, mode);
    }
    return text + "\n" + app->get_footer() + "\n";
  }

  std::string make_option(const CLI::Option* option, bool is_positional) const override {
    const std::string blank(get_column_width(), ' '), description = make_option_desc(option);
    std::string text = "  " + make_option_name(option, is_positional) + make_option_opts(option);
    if (text.size() >= blank.size() && !description.empty()) text += "\n" + blank;
    if (text.size() < blank.size()) text.resize(blank.size(), ' ');
    for (const char c : description) c == '\n' ? text += "\n" + blank : text += c;
    return text + "\n";
  }
};

/// Numbers are decimal, or the words inf and nan, which the ranges of most flags leave out. The parser's own conversion
/// also reads hexadecimal, octal and blanks, and takes what is too large for infinity.
std::string whyNoNumber(const std::string& text) {
  if (text == "inf" || text == "-inf" || text == "nan") return {};
  const auto is = [](char c, const char* set) { return c != '\0' && std::strchr(set, c) != nullptr; };
  constexpr const char* kDigits = "0123456789";
  const char* at = text.c_str();
  const auto digits = [&] {
    const char* const first = at;
    while (is(*at, kDigits)) ++at;
    return at - first;
  };
  if (is(*at, "+-")) ++at;
  const auto whole = digits();
  const auto part = *at == '.' ? (++at, digits()) : 0;
  bool good = whole + part > 0;
  if (good && is(*at, "eE")) {
    if (is(*++at, "+-")) ++at;
    good = digits() > 0;
  }
  good = good && at == text.c_str() + text.size();
  const bool leading_zero = whole > 1 && text[text.find_first_of(kDigits)] == '0' && part == 0;
  if (good && !leading_zero && std::isfinite(std::strtod(text.c_str(), nullptr))) return {};
  return "\"" + text + "\" is not a decimal number";
}

/// The parser's own conversion takes -1 for the largest number that there is.
std::string whyNoCount(const std::string& text) {
  std::string why = whyNoNumber(text);
  return why.empty() && text.front() == '-' ? "\"" + text + "\" is below 0" : why;
}

}  // namespace

struct FlagParser::Parser {
  CLI::App app;
};

FlagParser::FlagParser(std::string program) : parser_(std::make_unique<Parser>()), program_(std::move(program)) {}
FlagParser::~FlagParser() = default;

void FlagParser::describe(const std::string& verb, const std::string& purpose, const std::string& example) {
  verb_ = verb;
  parser_->app.name(command());
  parser_->app.description(purpose);
  parser_->app.footer("Example:\n  " + example);
  parser_->app.formatter(std::make_shared<Help>());
}

void FlagParser::option(const std::string& name, Target value, const std::string& help) {
  const auto add = [&](auto* target) { return parser_->app.add_option(name, *target, help)->capture_default_str(); };
  CLI::Option* option = std::visit([&](auto* target) -> CLI::Option* { return add(target); }, value);
  if (std::holds_alternative<std::uint64_t*>(value)) {
    option->check(whyNoCount, "");
  } else if (!std::holds_alternative<std::string*>(value)) {
    option->check(whyNoNumber, "");
  }
}

void FlagParser::repeated(const std::string& name, std::string* value, const std::string& help) {
  CLI::Option* option = parser_->app.add_option(name, *value, help)->capture_default_str();
  option->multi_option_policy(CLI::MultiOptionPolicy::Join)->delimiter(kBetweenValues);
}

void FlagParser::list(const std::string& name, std::vector<std::string>& values, const std::string& help,
                      std::optional<char> separator) {
  CLI::Option* option = parser_->app.add_option(name, values, help);
  if (separator) {
    option->delimiter(*separator);
  } else {
    option->allow_extra_args(false);
  }
}

void FlagParser::flag(const std::string& name, bool& value, const std::string& help) {
  parser_->app.add_flag(name, value, help);
}

std::string FlagParser::help() const {
  CLI::App& app = parser_->app;
  if (const auto options = app.get_options(); options.size() >= kManyFlags) {
    for (CLI::Option* option : app.get_options(nullptr)) option->group(groupOf(option->get_single_name()));
  }
  return app.help();
}

bool FlagParser::parse(const std::vector<std::string>& arguments) {
  // Often a shell's variable that is not set: what it was to limit would have no limit.
  const auto refuseEmpty = [this](const std::string& name) {
    throw InvalidArgument("usage.option", verb_, name + " is given an empty text", "Give it a value, or leave it out");
  };
  for (const std::string& argument : arguments) {
    if (argument == "--") break;
    const auto end = argument.find('=');
    if (argument.starts_with("--") && end + 1 == argument.size()) refuseEmpty(argument.substr(0, end));
  }
  try {
    parser_->app.parse(std::vector<std::string>(arguments.rbegin(), arguments.rend()));
  } catch (const CLI::CallForHelp&) {
    return false;
  } catch (const CLI::ParseError& error) {
    std::string problem = error.what();
    while (!problem.empty() && (problem.back() == '.' || problem.back() == '\n')) problem.pop_back();
    throw InvalidArgument("usage.option", verb_, problem, "See " + command() + " --help");
  }
  for (const CLI::Option* option : std::as_const(parser_->app).get_options()) {
    if (std::ranges::find(option->results(), std::string()) != option->results().end()) refuseEmpty(option->get_name());
  }
  return true;
}

bool FlagParser::has(const std::string& key) const { return parser_->app.get_option_no_throw("--" + key) != nullptr; }

bool FlagParser::repeats(const std::string& key) const {
  const CLI::Option* option = parser_->app.get_option_no_throw("--" + key);
  return option != nullptr && option->get_multi_option_policy() == CLI::MultiOptionPolicy::Join;
}

bool FlagParser::isSet(const std::string& key) const { return parser_->app.count("--" + key) > 0; }

std::optional<std::string> FlagParser::set(const std::string& key, const std::string& text) {
  CLI::Option* option = parser_->app.get_option("--" + key);
  try {
    option->add_result(text);
    option->run_callback();
  } catch (const CLI::ParseError& error) {
    return error.what();
  }
  return std::nullopt;
}

std::vector<FlagParser::Setting> FlagParser::settings() const {
  std::vector<Setting> settings;
  for (const CLI::Option* option : std::as_const(parser_->app).get_options()) {
    const std::string key = option->get_single_name();
    if (option->get_lnames().empty()) continue;
    if (option->get_expected_max() == 0) {
      settings.push_back({key, option->count() > 0 && option->as<bool>()});
    } else {
      const bool joins = option->get_multi_option_policy() == CLI::MultiOptionPolicy::Join;
      std::string text = option->get_default_str();
      if (option->count() > 0) text = joins ? option->as<std::string>() : option->results().front();
      settings.push_back({key, text});
    }
  }
  return settings;
}

}  // namespace accessvdb::tools
