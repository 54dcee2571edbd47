// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The leaves that the tool and the corridor read around a group of blocks, by horizontal offset.
#pragma once

#include <cstdint>

#include "cuda/update/update_views.cuh"
#include "launch/device_array.h"
#include "launch/exact_updater.h"

namespace accessvdb::kernels {

class FootprintTable {
 public:
  FootprintTable(DeviceMemory& memory, const ToolTables& tables, int group_log2);

  [[nodiscard]] const FootprintView& view() const { return view_; }
  /// Everything that searches read around the voxel of a point: the tool, in whole slabs, and the corridor.
  [[nodiscard]] VoxelBox reachOfSearch() const;

 private:
  FootprintView view_;
  int group_log2_;
  DeviceArray<FootprintColumn> tool_, arm_;
  DeviceArray<FootprintPlace> places_, heights_;
};

}  // namespace accessvdb::kernels
