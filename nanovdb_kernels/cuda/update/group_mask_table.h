// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the flips of an update mean for groups of blocks and one tool.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>
#include <memory>
#include <utility>

#include "cuda/memory/growing.h"
#include "cuda/memory/range_array.h"
#include "cuda/update/update_kernels.h"
#include "launch/device_array.h"

namespace accessvdb::kernels {

class GroupMaskTable {
 public:
  GroupMaskTable(std::shared_ptr<DeviceContext> context, DeviceMemory& memory)
      : memory_(memory), masks_(std::move(context)) {}

  /// Bytes not taken from `memory`.
  [[nodiscard]] std::uint64_t mappedBytes() const { return masks_.bytes(); }

  /// Directions that the flips may have changed for the points of each group. Empty if there were no flips.
  [[nodiscard]] const GroupMasksView& masks() const { return view_; }

  void clear() { view_ = {}; }
  /// Finds those directions, and ages what is known about them. Only queues work.
  void make(const FlipContext& context, std::uint32_t points, const FlipsView& flips, cudaStream_t stream) {
    masked_groups_ = context.groups.groups;
    masks_.grow(masked_groups_);
    affected_.growWithRoom(memory_, masked_groups_, roomFor(masked_groups_), 0);
    view_ = {masks_.data(), affected_.data(), nullptr};
    if (context.corridors.table != nullptr && context.known.remembers()) {
      const std::size_t words = (points + 31) / 32;
      arm_bits_.growWithRoom(memory_, words, roomFor(words), 0);
      fillBytes(arm_bits_.data(), 0, words * sizeof(std::uint32_t), stream);
      view_.arm_bits = arm_bits_.data();
    }
    launchGroupMasks(context, flips, view_, stream);
  }
  /// Adds groups that are new since then: nothing is known about their points that flips could change.
  void addGroups(std::uint32_t groups, cudaStream_t stream) {
    if (view_.affected == nullptr || groups == masked_groups_) return;
    masks_.grow(groups);
    affected_.growWithRoom(memory_, groups, roomFor(groups), masked_groups_);
    fillBytes(affected_.data() + masked_groups_, 0, groups - masked_groups_, stream);
    view_.masks = masks_.data();
    view_.affected = affected_.data();
    masked_groups_ = groups;
  }

 private:
  DeviceMemory& memory_;
  GroupMasksView view_;
  RangeArray<GroupMasks> masks_;
  DeviceArray<std::uint8_t> affected_;
  DeviceArray<std::uint32_t> arm_bits_;
  std::uint32_t masked_groups_ = 0;
};

}  // namespace accessvdb::kernels
