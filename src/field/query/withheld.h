// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Points that are told as unscored, whatever was found when they were last scored. Their state stays as it is:
/// schedulers compare with it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "accessvdb/point_label.h"

namespace accessvdb::internal {

struct Withheld {
  std::span<const std::uint8_t> for_all = {};  ///< by id, see LeftOutPoints: for every tool
  std::span<const std::uint8_t> waiting = {};  ///< by id, PointScorer::waiting()

  [[nodiscard]] bool any() const;
};

/// What is told of points with the ids first, first + 1 ...
struct ToldPoints {
  std::span<PointLabel> labels;
  std::span<PointReason> reasons;
  std::span<std::uint16_t> scores, directions;
  std::size_t first = 0;

  void withhold(const Withheld& withheld) const;
};

}  // namespace accessvdb::internal
