// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Results as GeoTIFF and GeoPackage, in the coordinate system of the survey. A program without GDAL has no_gis.cpp.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "accessvdb/survey_frame.h"
#include "runs/prepared_file.h"

namespace accessvdb::tools {

/// @throws InvalidArgument "usage.no_gdal" in a program without it; UnusableInput "gdal.missing" if it is not installed
void requireGis(const std::string& flag);

/// Seen from above: of each cell the share of its surface that can be reached, and its square metres.
/// @param points  files of points.ply  @param cell_m  edge of a cell, metres
/// @throws InvalidArgument "usage.cell" for more cells than are possible; InputError, OutputError
[[nodiscard]] PreparedFile shareRaster(const std::filesystem::path& file,
                                       const std::vector<std::filesystem::path>& points, const SurveyFrame& frame,
                                       double cell_m);

/// The accessible points, each with its approach and what its returns carried.
[[nodiscard]] PreparedFile targetLayer(const std::filesystem::path& file,
                                       const std::vector<std::filesystem::path>& points, const SurveyFrame& frame);

}  // namespace accessvdb::tools
