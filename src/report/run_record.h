// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// report.json as far as the page shows it. Runs of older versions lack some of it, and so may any folder: what is
/// missing is left out.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace accessvdb::internal {

struct RunRecord {
  nlohmann::ordered_json shown;  ///< an object; null without a report.json
  std::optional<std::uint64_t> surface_points;
  std::map<std::string, std::string> sha256_of;  ///< of each input, by its path
  std::vector<std::string> tool_files;           ///< each tool's, in their order; "builtin:..." is none

  /// @throws InputError "input.report" for what is not JSON
  static RunRecord read(const std::filesystem::path& folder);
};

}  // namespace accessvdb::internal
