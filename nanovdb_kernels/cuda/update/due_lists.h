// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The points to evaluate, by block, and the order of the blocks.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>

#include "cuda/update/update_views.cuh"
#include "launch/device_array.h"

namespace accessvdb::kernels {

class DueLists {
 public:
  /// Items that are evaluated at a time: at least kLeastItems, so that one part of the points always has room.
  static constexpr std::uint32_t kLeastItems = 1u << 18, kMaxItems = 1u << 21;

  DueLists(DeviceMemory& memory, SearchCounters* counters) : memory_(memory) { view_.counters = counters; }

  /// Valid until the next grow call.
  [[nodiscard]] const DueView& view() const { return view_; }
  [[nodiscard]] std::uint32_t capacity() const { return static_cast<std::uint32_t>(items_.size()); }

  /// @param flags  [n] of WaitingFlag; null: what is due is evaluated at once
  void setWaiting(std::uint8_t* flags) { view_.waiting = flags; }
  void growBlocks(std::uint32_t blocks, cudaStream_t stream);
  void growItems(std::uint32_t points);

  /// Orders blocks so that nearby points, which read the same part of the map, are searched at the same time.
  /// @param busy  number of blocks with points due  @return the view with these blocks in the order of the search
  [[nodiscard]] DueView ordered(const BlockIndexView& index, std::uint32_t busy, cudaStream_t stream);

 private:
  DeviceMemory& memory_;
  DueView view_;
  DeviceArray<std::uint32_t> heads_, busy_, places_;  ///< by block
  DeviceArray<ListedDue> items_;
  DeviceArray<std::uint32_t> order_, whole_, keys_, sorted_, block_order_;
  DeviceArray<std::byte> scratch_;
};

}  // namespace accessvdb::kernels
