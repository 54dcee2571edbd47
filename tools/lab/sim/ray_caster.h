// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Casts rays at a mesh, or at meshes placed many times, with Embree.
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
  /// Meshes in their own frames, and where each is placed: a copy costs a few hundred bytes.
  /// @throws InvalidArgument if there is nothing to hit, or an index without its mesh or vertex
  RayCaster(std::vector<TriangleMesh> meshes, std::span<const PlacedMesh> placed);
  ~RayCaster();
  RayCaster(RayCaster&&) noexcept;
  RayCaster& operator=(RayCaster&&) noexcept;

  /// Range to the first surface along each ray, infinity if there is none.
  /// @param directions_W  [n] unit  @param ranges_m  [n]
  void cast(const Eigen::Vector3d& origin_W, std::span<const Eigen::Vector3f> directions_W,
            std::span<float> ranges_m) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace accessvdb::sim
