// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Points that wait to be evaluated: each at most once, first come first served.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>
#include <vector>

#include "cuda/memory/pinned_buffer.h"
#include "cuda/update/update_views.cuh"
#include "launch/device_array.h"

namespace accessvdb::kernels {

class WorkQueue {
 public:
  explicit WorkQueue(DeviceMemory& memory);

  /// Makes room for ids below `points`; new ones have no flags.
  void grow(std::uint32_t points, cudaStream_t stream);
  /// [points] of WaitingFlag
  [[nodiscard]] std::uint8_t* flags() const { return flags_.data(); }

  /// Which points enter the queue.
  struct Rule {
    std::uint8_t mask = 0, value = 0;   ///< those with (flags & mask) == value
    const PointLabel* label = nullptr;  ///< [points] and not accessible; null: any label
  };
  /// Appends points in ascending order, and changes their flags from kAsked to kWaiting. Waits for the device.
  void addFrom(std::uint32_t points, const Rule& rule, cudaStream_t stream);
  /// The same for a list, in its order. @param ids  all different
  void addFromList(DeviceList<std::uint32_t> ids, const Rule& rule, cudaStream_t stream);

  [[nodiscard]] std::uint32_t size() const { return size_; }
  /// In queue order; valid until the next call. The points keep their flags.
  [[nodiscard]] std::uint32_t* ids() const { return ids_.data(); }
  /// Removes the first `count` points.
  void drop(std::uint32_t count, cudaStream_t stream);
  /// Those that wait, in queue order, and how many of them are accessible by `label` ([points]). Waits for the device.
  struct Left {
    std::vector<std::uint32_t> ids;
    std::uint32_t accessible = 0;
  };
  [[nodiscard]] Left left(const PointLabel* label, cudaStream_t stream);

 private:
  template <typename Input>
  void select(Input input, std::uint32_t count, const Rule& rule, cudaStream_t stream);

  DeviceMemory& memory_;
  DeviceArray<std::uint8_t> flags_;
  DeviceArray<std::uint32_t> ids_, rest_;  ///< [points]; rest_ is empty until points are left over
  std::uint32_t size_ = 0;
  DeviceArray<std::byte> scratch_;
  DeviceArray<std::uint32_t> selected_;  ///< [1]
  PinnedBuffer selected_on_host_;
};

}  // namespace accessvdb::kernels
