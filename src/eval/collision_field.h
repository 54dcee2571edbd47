// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Fast, exact answers to "is the signed distance at x below r?", for hundreds of millions of questions to one scene.
///
/// A signed distance is 1-Lipschitz: |d(x) - d(c)| <= |x - c|. So a distance kept at a cell's centre decides most
/// questions with certainty, and the few that it leaves open go to the distance itself. No answer is approximate: each
/// equals that of SignedDistance::at, whatever the size of the cells; they only decide how long it takes.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <limits>
#include <memory>

#include "sim/signed_distance.h"

namespace accessvdb::eval {

/// Distances at the centres of cells with edges of 16, 4 and 1 times `cell_m`, each asked for when it is needed first:
/// what no question comes near costs nothing. May be asked from several threads at once; the answers do not depend on
/// which of them came first.
class CollisionField {
 public:
  /// @param distance   1-Lipschitz, as every signed distance is
  /// @param box_W      where questions are cheap; elsewhere they are answered too, more slowly
  /// @param cell_m     edge of the finest cells; about twice the r of most questions is fastest
  /// @param max_bytes  of the cells; beyond that no finer ones are made, and answers come more slowly
  /// @throws InvalidArgument, ResourceLimit where the coarsest cells alone exceed max_bytes
  CollisionField(std::shared_ptr<const sim::SignedDistance> distance, const Eigen::AlignedBox3d& box_W, double cell_m,
                 std::uint64_t max_bytes = std::uint64_t(2) << 30);
  ~CollisionField();
  CollisionField(CollisionField&&) noexcept;

  /// distance().at(p_W) < r_m. True for a point that is not finite: bad data collides.
  [[nodiscard]] bool below(const Eigen::Vector3d& p_W, double r_m) const;

  struct Bounds {
    double lower_m, upper_m;  ///< lower <= distance().at(p) <= upper
  };
  /// From cells alone. No finer ones are looked at than it takes to settle that the distance is below low_m, or not
  /// below high_m; where neither can be had, the finest. Tell what you need: fine cells are dear when they are new.
  [[nodiscard]] Bounds bounds(const Eigen::Vector3d& p_W, double low_m = -std::numeric_limits<double>::infinity(),
                              double high_m = std::numeric_limits<double>::infinity()) const;

  [[nodiscard]] const sim::SignedDistance& distance() const;
  [[nodiscard]] std::uint64_t bytes() const;  ///< of the cells made so far

  struct Work {
    std::uint64_t cells_filled = 0;  ///< distances asked for to fill cells
    std::uint64_t left_open = 0;     ///< questions that cells could not decide
  };
  /// Of all threads. Not while one of them asks.
  [[nodiscard]] Work work() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace accessvdb::eval
