// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Flips that wait for an update on a device, in the order in which they were noted: one list of several
/// (launch/exact_updater.h).
#pragma once

#include <cstdint>
#include <vector>

#include "accessvdb/leaf_change.h"
#include "launch/exact_updater.h"
#include "launch/scan_fuser.h"

namespace accessvdb::internal {

class WaitingFlips {
 public:
  /// @param with_voxels  whether each voxel that began or ceased to collide is named
  void add(const LeafChange& change, bool with_voxels);
  /// Takes what a device noted. @param fuser  has nothing afterwards
  void takeFrom(kernels::ScanFuser& fuser) { fuser.takeFlips(leaves_, voxels_); }
  /// Counts the voxels of the leaves from there on.
  void beginVoxelsAt(std::uint32_t first);
  /// Merges what happened to a leaf. A voxel that came back to what it was is not named any more.
  void join();
  void clear();

  [[nodiscard]] const std::vector<kernels::LeafFlips>& leaves() const { return leaves_; }
  /// flipped_voxel::codeOf()
  [[nodiscard]] const std::vector<std::uint16_t>& voxels() const { return voxels_; }
  [[nodiscard]] std::uint64_t bytes() const {
    return leaves_.capacity() * sizeof(kernels::LeafFlips) + voxels_.capacity() * sizeof(std::uint16_t);
  }

 private:
  std::vector<kernels::LeafFlips> leaves_;
  std::vector<std::uint16_t> voxels_;
  std::uint32_t first_ = 0;  ///< LeafFlips::first_voxel of the list's first voxel
};

}  // namespace accessvdb::internal
