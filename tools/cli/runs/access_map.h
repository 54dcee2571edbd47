// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// query --access-map: what stops the tool in each of its orientations at one point of a saved state.
#pragma once

#include <Eigen/Core>
#include <string>

#include "options/command_line.h"
#include "options/map_options.h"

namespace accessvdb::tools {

struct AccessMapOptions {
  CommonOptions common;
  MapOptions given;          ///< the tools, with what belongs to each
  std::string map, picture;  ///< state file or folder of a checkpoint; PNG
  std::string for_tool;      ///< name of one of several tools; empty: the one that stands for the point
  bool json = false, allow_changed = false;
};

/// Draws the picture and prints what is in it.
/// @throws InvalidArgument "usage.access_map" for a folder without a checkpoint; InputError "query.no_point"
/// @throws as AccessibilityField::loadState
void drawAccessMap(const AccessMapOptions& options, const Eigen::Vector3d& p_W, Messages& messages);

}  // namespace accessvdb::tools
