// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Fast, exact answers to "is the signed distance at x below r?", for hundreds of millions of queries to one scene.
///
/// A signed distance is 1-Lipschitz: |d(x) - d(c)| <= |x - c|. So a distance stored at a cell's centre decides most
/// queries with certainty, and the few left open go to the distance itself. No answer is approximate: each equals that
/// of SignedDistance::at for any cell size; cells only affect the speed.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <limits>
#include <memory>

#include "sim/signed_distance.h"

namespace accessvdb::eval {

/// Distances at the centres of cells with edges of 16, 4 and 1 times `cell_m`, each computed when first needed: regions
/// without queries cost nothing. May be used from several threads at once; the answers do not depend on their order.
class CollisionField {
 public:
  /// @param distance   1-Lipschitz, as every signed distance is
  /// @param box_W      where queries are cheap; elsewhere they are slower
  /// @param cell_m     edge of the finest cells; about twice the r of most queries is fastest
  /// @param max_bytes  limit for the cells; beyond it no finer ones are made, and answers are slower
  /// @throws InvalidArgument, ResourceLimit if the coarsest cells alone exceed max_bytes
  CollisionField(std::shared_ptr<const sim::SignedDistance> distance, const Eigen::AlignedBox3d& box_W, double cell_m,
                 std::uint64_t max_bytes = std::uint64_t(2) << 30);
  ~CollisionField();
  CollisionField(CollisionField&&) noexcept;

  /// distance().at(p_W) < r_m. True for a point that is not finite: bad data collides.
  [[nodiscard]] bool below(const Eigen::Vector3d& p_W, double r_m) const;

  struct Bounds {
    double lower_m, upper_m;  ///< lower <= distance().at(p) <= upper
  };
  /// From cells alone. Uses no finer ones than needed to decide that the distance is below low_m, or not below high_m;
  /// if neither can be decided, the finest. State what you need: new fine cells are expensive.
  [[nodiscard]] Bounds bounds(const Eigen::Vector3d& p_W, double low_m = -std::numeric_limits<double>::infinity(),
                              double high_m = std::numeric_limits<double>::infinity()) const;

  [[nodiscard]] const sim::SignedDistance& distance() const;
  [[nodiscard]] std::uint64_t bytes() const;  ///< size of the cells made so far

  struct Work {
    std::uint64_t cells_filled = 0;  ///< distances computed to fill cells
    std::uint64_t left_open = 0;     ///< queries that cells could not decide
  };
  /// Sum over all threads. Not to be called during a query.
  [[nodiscard]] Work work() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace accessvdb::eval
