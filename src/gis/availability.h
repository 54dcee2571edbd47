// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Whether GDAL is installed, asked before work begins.
#pragma once

namespace accessvdb::gis {

/// @throws UnusableInput "gdal.missing"
void requireGdal();

}  // namespace accessvdb::gis
