// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/query/withheld.h"

#include <algorithm>

#include "accessvdb/types.h"
#include "field/left_out_points.h"

namespace accessvdb::internal {

bool Withheld::any() const {
  return !waiting.empty() || std::ranges::any_of(for_all, [](std::uint8_t why) { return why != 0; });
}

void ToldPoints::withhold(const Withheld& withheld) const {
  const std::size_t end = first + labels.size();
  const auto tell = [this](std::size_t id, PointReason reason) {
    labels[id - first] = PointLabel::Unscored;
    reasons[id - first] = reason;
    scores[id - first] = kNoScore;
    directions[id - first] = kNoDirection;
  };
  for (std::size_t id = first; id < std::min(end, withheld.waiting.size()); ++id) {
    if (withheld.waiting[id] != 0) tell(id, PointReason::Confidence);
  }
  for (std::size_t id = first; id < std::min(end, withheld.for_all.size()); ++id) {
    if (withheld.for_all[id] != 0) tell(id, reasonOf(withheld.for_all[id]));
  }
}

}  // namespace accessvdb::internal
