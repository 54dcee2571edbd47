// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Parts of a map as they are named on the command line.
#pragma once

#include <string>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/what_if.h"
#include "output/error_output.h"

namespace accessvdb::tools {

/// For --help.
inline constexpr const char* kRegionForms =
    "box:X0,Y0,Z0,X1,Y1,Z1, mesh:FILE (closed, in metres, world frame) or ids:1,2,3 or ids:FILE (one id per line)";

/// @throws InvalidArgument "usage.remove", "region.box", "region.empty"; UnusableInput "region.mesh"; InputError
[[nodiscard]] Region parseRegion(const std::string& text);
/// "unknown" or "free". @throws InvalidArgument "usage.removed_as"
[[nodiscard]] RemovedAs parseRemovedAs(const std::string& text);

/// Segments of a file: PLY with a segment of each point, else text with boxes. @throws InputError; UnusableInput
/// "segments.none" if no point of the map belongs to one
[[nodiscard]] std::vector<Segment> readSegments(const std::string& path, const AccessibilityField& field,
                                                Messages& messages);

}  // namespace accessvdb::tools
