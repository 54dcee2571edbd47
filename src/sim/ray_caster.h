// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Rays against a mesh, by Embree.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <span>

#include "sim/triangle_mesh.h"

namespace accessvdb::sim {

/// May be used from several threads at once.
class RayCaster {
 public:
  explicit RayCaster(const TriangleMesh& mesh);
  ~RayCaster();
  RayCaster(RayCaster&&) noexcept;
  RayCaster& operator=(RayCaster&&) noexcept;

  /// Range to the first surface along each ray, infinity where there is none.
  /// @param directions_W  [n] unit  @param ranges_m  [n]
  void cast(const Eigen::Vector3d& origin_W, std::span<const Eigen::Vector3f> directions_W,
            std::span<float> ranges_m) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace accessvdb::sim
