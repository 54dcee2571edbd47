// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What `bench` measured, frame by frame, and the figures derived from it.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "accessvdb/types.h"

namespace accessvdb::tools {

struct BenchFrame {
  FrameStats integration;
  UpdateStats update;
  double frame_ms = 0;           ///< from the scan in host memory to its labels; pipelined, from frame to frame
  std::uint64_t new_points = 0;  ///< voxels with their first return; filled in by BenchRecord::add()
};

class BenchRecord {
 public:
  /// @param distances  whether the mirror of distances has figures too
  explicit BenchRecord(bool distances) : distances_(distances) {}
  void add(BenchFrame frame);
  [[nodiscard]] std::size_t frames() const { return frames_.size(); }
  [[nodiscard]] const BenchFrame& last() const { return frames_.back(); }  ///< @pre frames() > 0
  /// Over the last `last` frames; 0 without any.
  [[nodiscard]] double framesPerSecond(std::size_t last) const;
  /// Points in the map before frame n; n = frames() for those at the end.
  [[nodiscard]] std::uint64_t surfacePointsBefore(std::size_t n) const;
  /// Share of the returns of frames begin .. end that made a new point. @pre begin < end <= frames()
  [[nodiscard]] double newPercent(std::size_t begin, std::size_t end) const;
  /// Returns per point of the map before frame n; 0 without points.
  [[nodiscard]] double hitsPerVoxelBefore(std::size_t n) const;

  /// "frame", "integrate", "mirror", "update", "score" (and "distance_mirror"): {mean, p50, p95, p99, max} over the
  /// last `last` frames.
  [[nodiscard]] nlohmann::ordered_json timing_ms(std::size_t last) const;
  /// The same statistics for every counter.
  [[nodiscard]] nlohmann::ordered_json counters(std::size_t last) const;
  /// Over the last `last` frames: the most points left over, their share of the map in percent, and the most
  /// consecutive updates that left some, an upper bound on how long a point waited.
  [[nodiscard]] nlohmann::ordered_json backlog(std::size_t last) const;
  /// One line per frame, times in milliseconds; the first line has the column names.
  [[nodiscard]] std::string csv() const;

 private:
  bool distances_;
  std::vector<BenchFrame> frames_;
};

}  // namespace accessvdb::tools
