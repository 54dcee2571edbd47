// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A raster as GeoTIFF, by GDAL.
#pragma once

#include <iosfwd>
#include <string>
#include <vector>

#include "accessvdb/survey_frame.h"

namespace accessvdb::gis {

struct Raster {
  int columns = 0, rows = 0;
  double west = 0, north = 0;            ///< of the outer corner, in the frame's unit
  double cell_x = 0, cell_y = 0;         ///< edges of a cell, in the frame's unit
  static constexpr float kNone = -9999;  ///< in place of a value
  struct Band {
    std::string name;
    std::vector<float> values;  ///< [rows x columns], from the north-west corner eastwards
  };
  std::vector<Band> bands;
};

/// Compressed without loss. @throws OutputError "gdal.failed"; UnusableInput "gdal.missing"
void writeGeoTiff(const Raster& raster, const SurveyFrame& frame, const std::string& software, std::ostream& out);

}  // namespace accessvdb::gis
