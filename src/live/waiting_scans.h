// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Scans that wait for their poses and their turn, and what becomes of those that never get one. Every scan is taken,
/// dropped for a reason that is counted, or waiting.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/live_session.h"
#include "live/live_poses.h"
#include "live/lost_returns.h"
#include "live/scan_times.h"

namespace accessvdb::internal {

/// As AccessibilityField::leaveOut() takes it, and farther than any return.
inline constexpr double kFarthestReturn_m = 1e6;

struct WaitingScan {
  LiveScan scan;
  std::uint64_t number = 0;
  std::chrono::steady_clock::time_point arrived;
  std::optional<TimedPoints> timed = {};
};

/// Not thread-safe.
class WaitingScans {
 public:
  /// @param cube_m  edge of the first cubes of returns that are lost
  WaitingScans(const LiveOptions& options, double max_range_m, double cube_m)
      : options_(options),
        max_range_m_(max_range_m),
        cube_m_(cube_m),
        poses_(options),
        times_(options.deskew, options.max_gap_s),
        lost_(cube_m) {}

  [[nodiscard]] LivePoses& poses() { return poses_; }
  [[nodiscard]] const LivePoses& poses() const { return poses_; }

  void add(LiveScan scan);
  void pause(bool paused) { paused_ = paused; }
  /// What scans before saw is forgotten, those that wait are dropped, and scans may come that are earlier.
  void forgetTaken();
  /// Whether the first one has its turn, or never will.
  [[nodiscard]] bool hasWork() const { return !queue_.empty() && (poses_.levelIsDue() || isSettled(queue_.front())); }

  struct Ready {
    WaitingScan waiting;
    SensorMotion motion;
    bool registered = false;  ///< its points are in the world frame
    bool late = false;        ///< so many wait behind it that it gets no labels of its own
    LostReturns lost;         ///< since the scan before
  };
  /// The oldest scan that has a pose, off the queue; those before it that will never have one are dropped.
  [[nodiscard]] std::optional<Ready> next();
  /// What lost scans saw, as far as their poses are known by now, for the step that follows.
  [[nodiscard]] LostReturns takeLost();

  void drop(std::uint64_t number, std::int64_t stamp_ns, ScanDrop reason);
  /// Those since the last call.
  [[nodiscard]] std::vector<DroppedScan> takeDropped();
  [[nodiscard]] std::size_t size() const { return queue_.size(); }
  /// Adds what is known here.
  void tell(LiveStatus& status) const;

 private:
  void drop(const WaitingScan& scan, ScanDrop reason) { drop(scan.number, scan.scan.stamp_ns, reason); }
  [[nodiscard]] std::optional<io::WholeMilliseconds> millisecondsOf(const WaitingScan& waiting) const;
  [[nodiscard]] bool isSettled(const WaitingScan& waiting) const;
  [[nodiscard]] bool isReady(const WaitingScan& waiting) const;
  void lose(const WaitingScan& waiting);
  void dropFromTheFuture(std::int64_t stamp_ns);
  void removeFirst();

  const LiveOptions options_;
  double max_range_m_, cube_m_;
  LivePoses poses_;
  ScanTimes times_;
  std::deque<WaitingScan> queue_;
  std::size_t waiting_returns_ = 0;  ///< weights of all scans in it
  LostReturns lost_;                 ///< of scans that there was no time for, until the next step
  /// The same of a scan whose pose is not there yet.
  struct Unplaced {
    std::string frame;
    std::int64_t stamp_ns = 0;
    std::optional<io::WholeMilliseconds> ms;
    bool registered = false;
    double farthest_m = 0;
    LostReturns returns;  ///< in the frame of the sensor, or of the poses
  };
  void place(const Unplaced& scan, const SensorMotion& motion);
  /// Until its pose comes.
  void remember(Unplaced scan);
  std::deque<Unplaced> unplaced_;
  bool all_lost_ = false;  ///< there were too many of them
  int late_in_a_row_ = 0;
  bool paused_ = false;
  std::deque<DroppedScan> dropped_;
  std::optional<std::int64_t> last_stamp_ns_;   ///< of the last scan that was put in the queue
  std::optional<std::int64_t> taken_stamp_ns_;  ///< of the last one that left it with a pose
  std::uint64_t published_ = 0, left_out_returns_ = 0;
  std::array<std::uint64_t, kNumScanDrops> drops_ = {};
};

}  // namespace accessvdb::internal
