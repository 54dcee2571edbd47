// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The CUDA backend: the rules of hostdev/ on an NVIDIA GPU.
#pragma once

#include <cstdint>
#include <memory>

#include "cuda/fusion/scan_fuser.h"
#include "launch/backend.h"

namespace accessvdb::kernels {

/// Which kernels search; all give the same results.
enum class SearchPath {
  Fast,    ///< one warp per point, the leaves around it in shared memory or, if too many, as Lowers
  Lowers,  ///< one warp per point, the nodes above those leaves in shared memory
  Tree,    ///< one warp per point, every voxel read from the root
  Plain    ///< one thread per point, the rules as they stand
};

/// For tests and benchmarks, not for users.
struct CudaOptions {
  SearchPath path = SearchPath::Fast;
  std::uint64_t memory_limit_bytes = 0;  ///< most device memory to hold; 0 = no limit
  std::uint32_t chunk_items = 1u << 16;  ///< most items in flight at a time
};

/// Device time of the last call in milliseconds.
struct DeviceTimes {
  float order_ms = 0, search_ms = 0, update_ms = 0;
};

class CudaBackend : public Backend {
 public:
  /// Counts collisions in every direction at every item's point, without filter or early stop.
  /// @param request  items, map, tool, approach and points are used
  /// @param counts   [count x D] host memory; 65534 = that many or more
  virtual void countCollisions(const ScoreRequest& request, std::uint16_t* counts) = 0;
  /// Times of the last scorePoints or countCollisions, summed over its chunks; only while timing is on.
  [[nodiscard]] virtual DeviceTimes lastTimes() const = 0;
  virtual void setTiming(bool on) = 0;
  virtual void setPath(SearchPath path) = 0;
  /// Returns when the device has nothing left to do.
  virtual void finish() = 0;
  /// makeScanFuser() with what tests need.
  [[nodiscard]] virtual std::unique_ptr<DeviceScanFuser> makeDeviceScanFuser(const FusionSetting& setting,
                                                                             const OccupancyGrid* grid) = 0;
  /// Allocations made so far.
  [[nodiscard]] virtual std::uint64_t allocations() const = 0;
};

/// Like makeCudaBackend() in launch/backend.h, with options.
[[nodiscard]] std::unique_ptr<CudaBackend> makeCudaBackend(const CudaOptions& options);

}  // namespace accessvdb::kernels
