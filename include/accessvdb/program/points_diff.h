// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What changed between two maps of the same place: which points opened or closed, and what appeared or is gone.
/// Made for the program `accessvdb`: unlike the headers above this folder, it may change with every version.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "accessvdb/export.h"
#include "accessvdb/field_io.h"
#include "accessvdb/types.h"

namespace accessvdb::io {

enum class PointChange : std::uint8_t {
  Opened = 0,      ///< accessible now, and was not
  Closed = 1,      ///< was accessible, and is not now
  Relabelled = 2,  ///< from blocked to not scored, or back
  Appeared = 3,    ///< a point where the earlier map has none
  Gone = 4         ///< a point of the earlier map where the later one has none
};
inline constexpr int kNumPointChanges = 5;
/// "opened", "closed", "relabelled", "appeared", "gone"
constexpr const char* name(PointChange change) {
  constexpr const char* kNames[kNumPointChanges] = {"opened", "closed", "relabelled", "appeared", "gone"};
  return kNames[static_cast<int>(change)];
}

/// One point that differs. Which sides exist follows from the change.
struct ChangedPoint {
  PointChange change = PointChange::Opened;
  PointLabel label_before = PointLabel::Unscored;
  PointReason reason_before = PointReason::Confidence;
  SurfacePoint point;  ///< of the later map; for Gone, of the earlier one
};

/// How a point of one map finds its counterpart in the other.
enum class PointMatch : std::uint8_t {
  SameVoxel,  ///< in the same voxel: both maps have the same origin
  Nearest     ///< the nearest within one voxel size
};

struct PointsDiff {
  PointMatch match = PointMatch::SameVoxel;
  Eigen::Vector3d origin_W = {0, 0, 0};  ///< of the earlier map
  double voxel_size_m = 0;
  std::uint64_t points_before = 0, points_after = 0;
  std::uint64_t same = 0;  ///< points of the later map with a counterpart that has the same label
  std::array<std::uint64_t, kNumPointChanges> changes = {};
  /// [label before, reason before, label after, reason after] of points with another label, most frequent first
  struct Transition {
    PointLabel label_before, label_after;
    PointReason reason_before, reason_after;
    std::uint64_t points = 0;
  };
  std::vector<Transition> transitions;
  /// Of several tools, in their order: points that both maps have and that this one reaches now and did not, or the
  /// reverse, whatever the others do. Empty with one tool.
  struct ToolChange {
    std::string name;
    std::uint64_t opened = 0, closed = 0;
  };
  std::vector<ToolChange> tools;
  std::vector<ChangedPoint> points;           ///< sorted by place, whatever the order in the files
  std::vector<std::string> other_parameters;  ///< "name: earlier, later" of each parameter that differs
};

/// Compares maps that are stored as one points.ply, or as one per tile.
/// A point of the later map has changed if the label of its counterpart is another one; it has appeared if it has none.
/// A point of the earlier map is gone if no point of the later one could be its counterpart. Of several candidates
/// the nearest counts, then the first by position. Takes about 48 bytes per point of the earlier map, and 120 per
/// change.
/// @param before, after  the files of each map; parts of one map have one origin
/// @throws UnusableInput "diff.voxel", "diff.tool" (maps of another voxel size or tool cannot be compared),
///         "diff.parts" (files that are not of one map)
/// @throws InputError for a file that cannot be read
[[nodiscard]] ACCESSVDB_API PointsDiff diffPoints(const std::vector<std::filesystem::path>& before,
                                                  const std::vector<std::filesystem::path>& after);

/// The changed points: x y z, red green blue, change (PointChange), label_before reason_before label reason (255 where
/// that side does not exist), and the best direction dx dy dz. @throws OutputError
ACCESSVDB_API void writeDiffPly(const std::filesystem::path& path, const PointsDiff& diff);
/// One fog per kind of change, named after it, in the earlier map's frame. @throws OutputError
ACCESSVDB_API void writeDiffVdb(const std::filesystem::path& path, const PointsDiff& diff);

}  // namespace accessvdb::io
