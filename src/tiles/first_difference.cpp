// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tiles/first_difference.h"

#include <algorithm>
#include <sstream>
#include <utility>
#include <vector>

namespace accessvdb::tiles {
namespace {

/// "name value" per line.
std::vector<std::pair<std::string, std::string>> valuesOf(const std::string& text) {
  std::vector<std::pair<std::string, std::string>> values;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    const std::size_t blank = std::min(line.find(' '), line.size());
    values.emplace_back(line.substr(0, blank), line.substr(std::min(blank + 1, line.size())));
  }
  return values;
}

}  // namespace

std::string firstDifference(const std::string& then, const std::string& now) {
  const auto before = valuesOf(then), after = valuesOf(now);
  const auto in = [](const auto& values, const std::string& name) {
    const auto found =
        std::find_if(values.begin(), values.end(), [&](const auto& value) { return value.first == name; });
    return found == values.end() ? std::string("none") : found->second;
  };
  for (const auto& [name, value] : before) {
    if (in(after, name) != value) return name + " " + value + " instead of " + in(after, name);
  }
  for (const auto& [name, value] : after) {
    if (in(before, name) != value) return name + " " + in(before, name) + " instead of " + value;
  }
  return "other values";
}

}  // namespace accessvdb::tiles
