// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the returns of a recording show of the world, for judging labels where no exact scene is known: surfaces, the
/// space that rays went through, and what nobody saw. Shares no function with the method: no fused distances, no
/// cleared bands, no points of the map.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

namespace accessvdb::eval {

/// A return and where its ray began.
struct SeenReturn {
  Eigen::Vector3d p_W, sensor_W;
};

struct DenseViewOptions {
  double voxel_size_m = 0.01;
  double range_noise_m = 0;  ///< sigma of a return along its ray
  double depth_m = 0.04;     ///< how far behind a surface its thing is taken to reach; what is deeper is unseen
};

/// Surfaces are patches: planes through the returns around a place, as wide as the returns that they were fitted to.
class DenseView {
 public:
  enum class Is : std::uint8_t { Free, Solid, Unseen };

  /// Takes 24 bytes more for each return while it is made.
  DenseView(std::span<const SeenReturn> returns, const DenseViewOptions& options);
  ~DenseView();
  DenseView(DenseView&&) noexcept;

  /// Solid: closer than `closer_than_m` to the front of a patch, or behind it and not deeper than depth_m. Free: right
  /// before a patch, or in a cell of two voxels that a ray passed, or next to one. Thread-safe.
  [[nodiscard]] Is at(const Eigen::Vector3d& p_W, double closer_than_m) const;
  /// Whether a patch lies at this place, before or behind it within depth_m.
  [[nodiscard]] bool hasSurfaceAt(const Eigen::Vector3d& p_W) const;
  [[nodiscard]] std::size_t patches() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace accessvdb::eval
