// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Writes grids to a .vdb file one after the other.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "accessvdb/field_io.h"
#include "accessvdb/surface_points.h"
#include "accessvdb/write_options.h"
#include "vdb/standard_grids.h"

namespace accessvdb::internal {

/// One grid of a file: its name, and how to make it on demand.
struct LazyGrid {
  std::string name;
  std::function<openvdb::GridBase::Ptr()> make;
};

/// Writes grids one after the other: only one is in memory at a time. With offsets if the stream can seek.
/// @param full_bytes  if not null, receives the bytes of the same file with 32-bit floats
void writeGrids(std::ostream& stream, const std::vector<LazyGrid>& grids, const openvdb::MetaMap& metadata,
                io::Compression compression = io::Compression::Auto, std::uint64_t* full_bytes = nullptr);

/// OpenVDB's flags for a compression, given the available codecs. @throws InvalidArgument for a missing one
[[nodiscard]] std::uint32_t compressionFlags(io::Compression compression, bool has_blosc, bool has_zip);
/// The same for the OpenVDB of this process.
[[nodiscard]] std::uint32_t compressionFlags(io::Compression compression);

/// Origin, voxel size, version, up axis and the given pairs; pairs with names already used are skipped.
[[nodiscard]] openvdb::MetaMap fieldMetadata(const SurfacePoints& points, const io::FieldMetadata& metadata,
                                             const io::WriteOptions& options = {});

/// field.vdb from the points and from the three grids of the volume, each made on demand.
struct VolumeGrids {
  std::function<openvdb::FloatGrid::Ptr()> distance;
  std::function<openvdb::FloatGrid::Ptr()> weight;
  std::function<openvdb::BoolGrid::Ptr()> cleared;
};
void writeFieldGrids(const std::filesystem::path& path, const VolumeGrids& volume, const SurfacePoints& points,
                     const io::FieldMetadata& metadata, const io::WriteOptions& options = {});

}  // namespace accessvdb::internal
