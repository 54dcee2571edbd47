// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The space of the map at one moment, leaf by leaf. From the moment on that memory is used up, only returns inside are
/// fused, so that the map grows by no more than the leaves around them.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "accessvdb/accessibility_field.h"

namespace accessvdb::internal {

class KnownSpace {
 public:
  explicit KnownSpace(const AccessibilityField& field);

  /// Whether the map had a leaf at a position in the world frame. False for positions that are not finite.
  [[nodiscard]] bool contains(const Eigen::Vector3d& p_W) const;

 private:
  Eigen::Vector3d origin_W_;
  double voxel_size_m_;
  std::vector<std::uint64_t> leaves_;  ///< keys, sorted
};

}  // namespace accessvdb::internal
