// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Scans of which no return carries an attribute that others have.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "accessvdb/attributes.h"
#include "accessvdb/scan_io.h"
#include "io/streams/input_file.h"

namespace accessvdb::io {

class MissingAttributes {
 public:
  /// Looks at the values, because files differ in how they leave one out.
  /// @param attributes  of the returns, row by row  @param carry  their names
  void note(const std::vector<std::int32_t>& attributes, const std::vector<std::string>& carry, std::size_t step) {
    const std::size_t width = carry.size();
    for (std::size_t c = 0; c < width && !attributes.empty(); ++c) {
      bool found = false;
      for (std::size_t n = c; n < attributes.size() && !found; n += width) found = attributes[n] != kNoAttribute;
      if (!found && !carry[c].starts_with('@')) steps_[carry[c]].insert(step);
    }
  }
  /// @param steps  of the whole sequence  @param pathOf  (step) -> its file
  void addWarnings(std::size_t steps, const std::function<std::string(std::size_t)>& pathOf,
                   std::vector<ScanWarning>& warnings) const {
    for (const auto& [name, without] : steps_) {
      const std::filesystem::path first = pathOf(*without.begin());
      warnings.push_back({"carry.some_missing", "no return has " + name + " in " + std::to_string(without.size()) +
                                                    " of " + std::to_string(steps) + " steps, first in " +
                                                    forMessage(first.native()) +
                                                    ": they do not count where it is decided"});
    }
  }

 private:
  std::map<std::string, std::set<std::size_t>> steps_;
};

}  // namespace accessvdb::io
