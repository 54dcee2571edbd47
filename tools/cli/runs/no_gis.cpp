// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// export --raster and --vector in a program that was built without GDAL.
#include "accessvdb/error.h"
#include "runs/gis_files.h"

namespace accessvdb::tools {

void requireGis(const std::string& flag) {
  throw InvalidArgument("usage.no_gdal", flag, "this program was built without GDAL",
                        "Install libgdal-dev and build it again, or convert points.las with QGIS or PDAL");
}

PreparedFile shareRaster(const std::filesystem::path&, const std::vector<std::filesystem::path>&, const SurveyFrame&,
                         double) {
  requireGis("--raster");
  return {};
}

PreparedFile targetLayer(const std::filesystem::path&, const std::vector<std::filesystem::path>&, const SurveyFrame&) {
  requireGis("--vector");
  return {};
}

}  // namespace accessvdb::tools
