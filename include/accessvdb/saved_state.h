// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a saved state (AccessibilityField::saveState) says of itself.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "accessvdb/export.h"
#include "accessvdb/params.h"

namespace accessvdb {

struct SavedState {
  /// One of several tools; see ToolSpec.
  struct Tool {
    std::string name, sha256, orientations;
    int rolls = 0, max_collisions = 0;
  };
  std::string version;                   ///< of the program that wrote it
  std::string tool_sha256;               ///< ToolGeometry::sha256(), or toolListSha256() of several tools
  std::vector<Tool> tools;               ///< if there are several
  std::string sha256;                    ///< of its head; two states of one run differ in it
  FieldParams params;                    ///< resolved; backend and threads are defaults
  bool updated = false;                  ///< after an update(): loading it makes the labels again
  std::uint64_t scans = 0;               ///< calls of integrateScan() and integrateRays()
  std::optional<double> latest_stamp_s;  ///< AccessibilityField::latestStamp_s()
  std::uint64_t leaves = 0;              ///< of the map
  std::uint64_t points = 0;              ///< surface points
};

/// Reads the head only, in no time. Damage in the rest is found by AccessibilityField::loadState.
/// @throws InputError "state.format" (not a state), "state.damaged"
/// @throws UnusableInput "state.rules" (written by a program with other rules)
[[nodiscard]] ACCESSVDB_API SavedState inspectState(const std::filesystem::path& file);

}  // namespace accessvdb
