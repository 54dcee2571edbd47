// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Names of what returns carry.
#include "field/carry.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <iterator>
#include <set>
#include <span>

#include "accessvdb/error.h"
#include "accessvdb/survey_frame.h"

namespace accessvdb {
namespace {

/// Columns of our files, and those of their readers that mean something else.
constexpr std::array<std::string_view, 48> kOurs = {
    "x",      "y",         "z",        "nx",           "ny",         "nz",        "red",         "green",
    "blue",   "label",     "reason",   "score",        "confidence", "stability", "dx",          "dy",
    "dz",     "yaw",       "qw",       "qx",           "qy",         "qz",        "orientation", "roll",
    "tool",   "tools",     "margin_m", "free_arc_deg", "id",         "p",         "n",           "cd",
    "pscale", "direction", "scan",     "index",        "accessible", "blocked",   "unscored",    "alpha",
    "group",  "point",     "tile",     "fid",          "geom",       "all",       "position",    "access_probability"};
constexpr std::size_t kLongestColumn = 31;  // and a byte for the end, as LAS has it
constexpr std::size_t kMostCarried = 26;    // 24 and --index

std::string lower(std::string_view text) {
  std::string result(text);
  std::transform(result.begin(), result.end(), result.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return result;
}

bool isName(std::string_view name) {
  const auto letter = [](char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_'; };
  const auto good = [&](char c) { return letter(c) || (c >= '0' && c <= '9'); };  // as OpenVDB has it
  return !name.empty() && name.size() <= kLongestColumn && letter(name.front()) &&
         std::all_of(name.begin(), name.end(), good);
}

/// The names of survey_frame.h, all of them.
bool areFirstReturns(std::span<const CarriedAttribute> carry) {
  return std::equal(carry.begin(), carry.end(), std::begin(kFirstReturnNames), std::end(kFirstReturnNames),
                    [](const CarriedAttribute& attribute, const char* name) {
                      return attribute.name == name && attribute.keep == Keep::First;
                    });
}

}  // namespace

std::string carryText(const std::vector<CarriedAttribute>& carry) {
  std::string text;
  for (const CarriedAttribute& attribute : carry) {
    if (isHidden(attribute)) continue;
    text += (text.empty() ? "" : " ") + attribute.name;
  }
  return text;
}

std::vector<CarriedAttribute> carryOf(std::string_view names) {
  std::vector<CarriedAttribute> carry;
  for (std::size_t begin = names.find_first_not_of(' '); begin < names.size();) {
    const std::size_t end = std::min(names.find(' ', begin), names.size());
    carry.push_back({std::string(names.substr(begin, end - begin)), Keep::Majority});
    begin = names.find_first_not_of(' ', end);
  }
  return carry;
}

void internal::requireCarry(const std::vector<CarriedAttribute>& carry) {
  const auto hidden = std::find_if(carry.begin(), carry.end(), isHidden);
  const std::vector<CarriedAttribute> named(carry.begin(), hidden);
  if (named.size() > kMostCarried) {
    throw InvalidArgument(
        "carry.count", "carry",
        "has " + std::to_string(named.size()) + " names; " + std::to_string(kMostCarried) + " are possible",
        "Carry fewer");
  }
  if (hidden != carry.end() && !areFirstReturns({hidden, carry.end()})) {
    throw InvalidArgument("carry.name", "carry " + hidden->name.substr(0, kLongestColumn),
                          "is no name of a column: @ is for what points.las alone has", "Give the column another name");
  }
  std::set<std::string> seen;
  for (const CarriedAttribute& attribute : named) {
    const std::string name = lower(attribute.name);
    if (attribute.keep == Keep::First && (name == "scan" || name == "index")) continue;
    if (!isName(attribute.name)) {
      throw InvalidArgument("carry.name", "carry \"" + attribute.name.substr(0, 64) + "\"",
                            "is no name of a column: up to 31 letters, digits or _, first a letter or _",
                            "Give the column another name: NAME=OTHER");
    }
    if (std::find(kOurs.begin(), kOurs.end(), name) != kOurs.end()) {
      throw InvalidArgument("carry.name", "carry " + attribute.name, "is the name of a column of the results",
                            "Give the column another name: " + attribute.name + "=OTHER");
    }
    if (!seen.insert(name).second) {
      throw InvalidArgument("carry.name", "carry " + attribute.name, "is there twice", "Name each once");
    }
  }
}

}  // namespace accessvdb
