// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// query --fits: whether the tool fits at given poses, in the map of a saved state.
#pragma once

#include <string>

#include "options/command_line.h"
#include "options/map_options.h"

namespace accessvdb::tools {

struct ToolFitOptions {
  CommonOptions common;
  MapOptions given;  ///< the tools, with what belongs to each
  std::string map, poses;
  std::string for_tool;  ///< name of one of several tools; empty: the first
  bool contact = false, along = false, json = false, allow_changed = false;
};

/// Prints CSV, or JSON. @throws InvalidArgument "usage.fits" for a folder without a checkpoint; as loadState()
void printToolFits(const ToolFitOptions& options, Messages& messages);

}  // namespace accessvdb::tools
