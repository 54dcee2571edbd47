// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Rays against a mesh, or against meshes that stand in many places, by Embree.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <span>
#include <vector>

#include "sim/placed_mesh.h"
#include "sim/triangle_mesh.h"

namespace accessvdb::sim {

/// May be used from several threads at once.
class RayCaster {
 public:
  explicit RayCaster(const TriangleMesh& mesh);
  /// Meshes in frames of their own and where each of them stands: a copy costs a few hundred bytes.
  /// @throws InvalidArgument for nothing to hit, or an index without its mesh or vertex
  RayCaster(std::vector<TriangleMesh> meshes, std::span<const PlacedMesh> placed);
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
