// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Poses of one frame in another over time, as recordings have them: in any order, repeated, with gaps and jumps.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "io/poses/pose_gap.h"

namespace accessvdb::io {

/// Nothing that carries a scanner moves this fast: faster is a correction of the estimate, not a motion.
inline constexpr double kFastest_m_s = 50;
/// Shorter steps are not called jumps, however fast they seem: stamps have jitter.
inline constexpr double kLeastJump_m = 1;

/// Until 2116. Half of the numbers, so that differences of stamps cannot overflow.
inline constexpr std::int64_t kMostStamp_ns = (std::int64_t{1} << 62) - 1;

class PoseTrack {
 public:
  struct Counts {
    std::uint64_t invalid = 0;    ///< not finite, or not a rotation: not kept
    std::uint64_t repeated = 0;   ///< of a stamp that was there already: not kept
    std::uint64_t backwards = 0;  ///< earlier than the one before
    std::uint64_t jumps = 0;      ///< see kFastest_m_s; there is no pose between the two
    std::int64_t first_jump_ns = 0;
    double largest_jump_m = 0;
  };

  /// @param max_gap_ns  longest gap that is interpolated over
  explicit PoseTrack(std::int64_t max_gap_ns = nanoseconds(kMaxPoseGap_s)) : max_gap_ns_(max_gap_ns) {}

  /// @param q  w x y z, of length 1 within what PoseChecker repairs
  void add(std::int64_t stamp_ns, const Eigen::Vector3d& p, const Eigen::Vector4d& q);
  /// Sorts, drops what is repeated, finds jumps. After the last add().
  void finish();
  /// Drops poses that follow another within that time; for recordings of many hours.
  void thin(std::int64_t spacing_ns);

  /// Interpolated over gaps of at most max_gap_ns, never extrapolated, not over jumps. After finish().
  [[nodiscard]] std::optional<Eigen::Isometry3d> at(std::int64_t stamp_ns) const;

  [[nodiscard]] const Counts& counts() const { return counts_; }
  [[nodiscard]] std::size_t size() const { return poses_.size(); }
  [[nodiscard]] bool empty() const { return poses_.empty(); }
  [[nodiscard]] std::int64_t first_ns() const { return poses_.front().stamp_ns; }
  [[nodiscard]] std::int64_t last_ns() const { return poses_.back().stamp_ns; }
  [[nodiscard]] std::uint64_t heldBytes() const { return poses_.capacity() * sizeof(Entry); }

 private:
  struct Entry {
    std::int64_t stamp_ns = 0;
    Eigen::Vector3d p = Eigen::Vector3d::Zero();
    std::array<double, 4> q = {1, 0, 0, 0};  ///< w x y z
    bool jumps = false;                      ///< between this and the next there is a jump

    [[nodiscard]] Eigen::Isometry3d pose() const;
  };

  std::int64_t max_gap_ns_;
  std::vector<Entry> poses_;
  Counts counts_;
};

/// Exact where a double has enough digits: nanoseconds since 1970 have 19.
[[nodiscard]] inline double seconds(std::int64_t stamp_ns) { return static_cast<double>(stamp_ns) * 1e-9; }

}  // namespace accessvdb::io
