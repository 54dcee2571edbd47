// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "update/host_scheduler.h"

#include <algorithm>
#include <utility>

namespace accessvdb::internal {

HostScheduler::HostScheduler(const ScheduledTool& tool, std::shared_ptr<ScanChanges> changes)
    : scorer_(tool.scorer),
      tables_(tool.tables),
      footprint_(tool.host.tool, tool.host.approach, scorer_.params().tsdf.voxel_size_m, 0),
      changes_(std::move(changes)) {
  changes_->addReader();
}

void HostScheduler::noteReturns(const TouchedPoints& touched, std::span<const Eigen::Vector3f>,
                                std::span<const Eigen::Vector3f>) {
  if (leads()) changes_->noteReturns(touched);
}

void HostScheduler::noteChanges(std::span<const Eigen::Vector3f>, std::span<const Eigen::Vector3f>,
                                const MapChanges& changes) {
  if (leads()) changes_->noteFlips(changes.facts);
}

bool HostScheduler::noteScored() {
  if (!scorer_.keepsAllOnHost()) return false;
  if (leads()) {
    changes_->noteScored();
    return true;
  }
  std::vector<std::uint32_t> known;
  for (std::uint32_t id = 0; id < scorer_.points().size(); ++id)
    if (scorer_.record(id).has_neighbourhood) known.push_back(id);
  scorer_.upload(known);
  return true;
}

void HostScheduler::takeChanges() {
  changes_->refresh();
  if (leads()) return;
  scorer_.grow();
  scorer_.adopt(changes_->scorer(), changes_->touched());
  scorer_.adopt(changes_->scorer(), changes_->changed().ids);
}

bool HostScheduler::findBlocks(std::uint32_t leaf_group, LeafGroupBlocks& found) const {
  const SurfaceIndex& index = scorer_.points().index();
  found.blocks.clear();
  bool any_changed = false;
  Index3 low = {}, high = {};  // leaves that points of the leaf group read
  for (std::size_t bit = 0; bit < 512; ++bit) {
    const std::uint32_t b = index.blockIn(leaf_group, bit);
    if (b == kNone || !changes_->anyScoredIn(b)) continue;
    const Index3& leaf = index.blocks()[b].leaf;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const std::int32_t first = leaf[axis] + footprint_.low()[axis], last = leaf[axis] + footprint_.high()[axis];
      low[axis] = found.blocks.empty() ? first : std::min(low[axis], first);
      high[axis] = found.blocks.empty() ? last : std::max(high[axis], last);
    }
    found.blocks.push_back(b);
    any_changed = any_changed || changes_->changedIn(b);
  }
  if (found.blocks.empty()) return false;
  found.flipped = !changes_->flips().empty() && found.flips.fill(changes_->flips(), low, high);
  return found.flipped || any_changed;
}

}  // namespace accessvdb::internal
