// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "accessvdb/field_export.h"

namespace accessvdb {
class AccessibilityField;
class SurfacePoints;
}  // namespace accessvdb

namespace accessvdb::internal {

/// Like writeField() into a folder that exists and that the caller guards against other processes.
/// @param points  of the field
void writeFieldFiles(const AccessibilityField& field, const SurfacePoints& points, const std::filesystem::path& folder,
                     const io::WriteOptions& options);

}  // namespace accessvdb::internal
