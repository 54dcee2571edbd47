// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Takes scans into the host's map behind a device that has them already: in order, on a thread of its own.
///
/// The host's map is the authority. Where a scan flips other voxels in it than on the device, which a hash says
/// (hostdev/flips_hash.h), that is remembered, and the map goes on.
#pragma once

#include <tbb/task_arena.h>

#include <Eigen/Core>
#include <array>
#include <condition_variable>
#include <cstdint>
#include <exception>
#include <functional>
#include <mutex>
#include <optional>
#include <vector>

#include "field/work_thread.h"
#include "tsdf/integration_result.h"

namespace accessvdb::internal {

/// For one thread at a time, as the field. Scans are numbered from 0, in the order of take().
///
/// If a scan fails on the host, its map is no longer that of the scans: none that follows is begun, and every call that
/// may throw throws the same exception again.
class MapFollower {
 public:
  /// Most scans that the device is ahead.
  static constexpr std::uint64_t kMostBehind = 4;
  /// What ScanIntegrator::integrate() takes.
  struct Scan {
    std::vector<Eigen::Vector3f> p_L;  ///< [n] returns in the local frame, metres
    std::vector<Eigen::Vector3f> q_L;  ///< [n] or [1] sensor positions in the local frame, metres
    ScanFrame frame;
  };
  /// Takes a scan into the map. @return IntegrationResult::flips_hash
  using Fuse = std::function<std::uint64_t(const Scan& scan)>;

  /// @param fuse  runs in an arena of its own, since the field's is the device's and that of points
  /// @param threads  0 = all
  MapFollower(Fuse fuse, int threads);
  /// Waits for the scan that is being taken; those behind it are not begun.
  ~MapFollower();
  MapFollower(const MapFollower&) = delete;
  MapFollower& operator=(const MapFollower&) = delete;

  /// Returns while the scan is behind, but waits while kMostBehind others are; without memory for a thread, until the
  /// scan is in the map.
  /// @param scan  afterwards empty, with memory of an earlier one; unchanged if this throws
  /// @param flips_hash  of the scan on the device
  void take(Scan& scan, std::uint64_t flips_hash);
  /// Waits until all scans are in the map, which then is the caller's until the next take().
  void join();

  /// Number of scans in the map.
  [[nodiscard]] std::uint64_t taken() const;
  /// Number of scans that wait or are being taken; after an error, those that were lost.
  [[nodiscard]] std::uint64_t behind() const;
  /// Largest behind() so far.
  [[nodiscard]] std::uint64_t mostBehind() const;
  /// Number of the first scan whose hash was another one on the device.
  [[nodiscard]] std::optional<std::uint64_t> diverged() const;

 private:
  struct Place {
    Scan scan;
    std::uint64_t flips_hash = 0;
  };
  void takeNext();

  Fuse fuse_;
  tbb::task_arena arena_;
  std::array<Place, kMostBehind> places_;  ///< scan n is in place n % kMostBehind
  mutable std::mutex mutex_;               ///< of what follows
  std::condition_variable changed_;
  std::uint64_t given_ = 0, taken_ = 0, most_behind_ = 0;
  std::optional<std::uint64_t> diverged_;
  std::exception_ptr error_;
  bool stop_ = false;
  WorkThread thread_;  ///< the last member: destroyed first, it waits for its work
};

}  // namespace accessvdb::internal
