// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The coordinate system of a survey for GDAL.
#pragma once

#include <memory>

#include "accessvdb/survey_frame.h"
#include "gis/gdal_library.h"

namespace accessvdb::gis {

struct ReferenceRelease {
  void operator()(OGRSpatialReferenceH reference) const { gdal().OSRDestroySpatialReference(reference); }
};
using SpatialReference = std::unique_ptr<void, ReferenceRelease>;

/// Null if the frame says nothing. @throws OutputError "gdal.failed" if GDAL cannot read it
[[nodiscard]] SpatialReference referenceOf(const SurveyFrame& frame);

}  // namespace accessvdb::gis
