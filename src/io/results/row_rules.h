// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What every row of points.ply holds to, whatever made it: a label that its own row contradicts is not taken for one.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "accessvdb/field_io.h"
#include "io/results/points_ply.h"

namespace accessvdb::internal {

class RowRules {
 public:
  RowRules() = default;
  /// @param metadata  of the file; rules about what it does not say are left out
  RowRules(const PointsPlyColumns& columns, const io::FieldMetadata& metadata);

  /// What contradicts what in the row, in words; null: nothing does. @param point  with what follows from its columns
  [[nodiscard]] const char* contradictionIn(const SurfacePoint& point) const;

 private:
  [[nodiscard]] bool isMarginOf(const SurfacePoint& point) const;
  [[nodiscard]] const char* contradictionInAccessible(const SurfacePoint& point) const;

  PointsPlyColumns columns_;
  std::vector<std::optional<double>> collision_limits_;  ///< of each tool; one if there is one
  std::vector<float> margins_m_;                         ///< of each tool, where some are grown
  std::optional<double> rolls_;
};

}  // namespace accessvdb::internal
