// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Writing a field for other programs: size, compression and up axis of the .vdb files, frames of a sequence, and a
/// level set of the surface. docs/file_formats.md describes the files.
#pragma once

#include <filesystem>

#include "accessvdb/export.h"
#include "accessvdb/field_io.h"
#include "accessvdb/write_options.h"

namespace accessvdb {

class AccessibilityField;

namespace io {

/// Like the functions in field_io.h. @throws InvalidArgument, OutputError
ACCESSVDB_API void writeFieldVdb(const std::filesystem::path& path, const TsdfVolume& volume,
                                 const FieldSnapshot& field, const FieldMetadata& metadata,
                                 const WriteOptions& options);
ACCESSVDB_API void writePointsVdb(const std::filesystem::path& path, const FieldSnapshot& field,
                                  const FieldMetadata& metadata, const WriteOptions& options);
/// The same from points that need not be in memory as a whole.
ACCESSVDB_API void writeFieldVdb(const std::filesystem::path& path, const TsdfVolume& volume,
                                 const SurfacePoints& points, const FieldMetadata& metadata,
                                 const WriteOptions& options);
ACCESSVDB_API void writePointsVdb(const std::filesystem::path& path, const SurfacePoints& points,
                                  const FieldMetadata& metadata, const WriteOptions& options);

}  // namespace io

/// Like AccessibilityField::write(): field.vdb, field_points.vdb and points.ply, each whole or not at all.
/// @throws InvalidArgument (options), OutputError
ACCESSVDB_API void writeField(const AccessibilityField& field, const std::filesystem::path& folder,
                              const io::WriteOptions& options);

/// Like writeField, for a field whose device was lost or ran out of memory half-way: what was fused, all points
/// unscored (AccessibilityField::unscoredSnapshot()), no level set. @throws also ResourceLimit "field.broken"
ACCESSVDB_API void writeFieldUnscored(const AccessibilityField& field, const std::filesystem::path& folder,
                                      const io::WriteOptions& options);

/// The content of field.vdb under a name of your choice: one frame of a sequence (field_0001.vdb, ...) while a map
/// grows. The folder must exist. @throws InvalidArgument (options), OutputError
ACCESSVDB_API void writeFieldFrame(const AccessibilityField& field, const std::filesystem::path& file,
                                   const io::WriteOptions& options);

}  // namespace accessvdb
