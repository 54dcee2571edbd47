// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// report.json as far as the page shows it. Runs of older versions lack some of it, and so may any folder: what is
/// missing is left out.
#pragma once

#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

namespace accessvdb::internal {

struct RunRecord {
  nlohmann::ordered_json shown;  ///< an object; null without a report.json
  std::optional<std::uint64_t> surface_points;
  std::string tool_file_sha256;  ///< of the tool's file, if it was read from one

  /// @throws InputError "input.report" for what is not JSON
  static RunRecord read(const std::filesystem::path& folder);
};

}  // namespace accessvdb::internal
