// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// An output folder of `map`, of either kind: one points.ply, or one for each tile.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/field_io.h"
#include "accessvdb/types.h"

namespace accessvdb::internal {

struct PointFile {
  std::string tile;  ///< its name; empty for a field in one piece
  std::filesystem::path path;
  std::uint64_t points = 0;
};

struct FieldFolder {
  std::filesystem::path path;
  std::vector<PointFile> files;
  std::uint64_t points = 0;
  Eigen::Vector3d origin_W = {0, 0, 0};
  double voxel_size_m = 0;
  io::FieldMetadata metadata;           ///< of the first file
  std::vector<std::string> attributes;  ///< names of what the returns carried
  std::vector<std::string> tools;       ///< names of several tools, in their order; with one tool empty
  bool complete = true;                 ///< every tile is finished

  /// Reads headers only. @param check  begins with the files  @throws InputError
  static FieldFolder open(const std::filesystem::path& folder, io::OutputCheck& check);
  /// Text of one entry of the metadata; empty if there is none.
  [[nodiscard]] std::string metadataOf(const std::string& name) const;
  /// Hands over all points, file by file, in the order of their ids, until `take` returns false.
  /// @throws InputError
  using Take = std::function<bool(const PointFile&, const SurfacePoint&, std::span<const std::int32_t> carried)>;
  void visit(const Take& take) const;
};

}  // namespace accessvdb::internal
