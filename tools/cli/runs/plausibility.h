// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Things that are allowed but most likely a mistake, found at the end of a run and printed as warnings.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <string>
#include <unordered_set>
#include <vector>

#include "accessvdb/scan_io.h"
#include "accessvdb/types.h"
#include "output/report.h"

namespace accessvdb::tools {

/// What the scans look like as a whole, from a sample of each.
class SceneStatistics {
 public:
  void add(const io::ScanRecord& record);

  [[nodiscard]] double medianRange_m() const;
  /// Median over the scans, from the second on, of the share of a scan that is where earlier scans saw something.
  /// Negative if unknown.
  [[nodiscard]] double medianOverlap() const;
  /// Distance of coordinates that are next to each other, in the median scan: because they are or were 32-bit floats,
  /// and because the file says so.
  [[nodiscard]] double floatStep_m() const;
  [[nodiscard]] double fileStep_m() const;
  [[nodiscard]] const Eigen::AlignedBox3d& sensors_W() const { return sensors_W_; }

 private:
  void addStep(const io::ScanRecord& record);
  void addReturn(const Eigen::Vector3d& origin_W, const Eigen::Vector3d& p_W);

  Eigen::AlignedBox3d sensors_W_;
  std::vector<float> ranges_m_;
  std::vector<double> overlaps_, float_steps_m_, file_steps_m_;
  std::unordered_set<std::uint64_t> seen_cells_;
};

struct RunFacts {
  const RunReport& report;
  const SceneStatistics& scene;
  Eigen::AlignedBox3d surface_W;  ///< bounds of the surface points
  Eigen::Vector3d origin_W = {0, 0, 0};
  double voxel_size_m = 0;
  Eigen::Vector3d tool_size_m = {0, 0, 0};
  double tool_reach_m = 0;
  bool level_approaches = false;  ///< no tool is tilted
};

struct Warning {
  std::string id, text;
};

/// "tool.unit" of a tool that no hand holds. @param size_m  along each axis
[[nodiscard]] std::optional<Warning> toolUnitWarning(const Eigen::Vector3d& size_m);
/// A sensor that mostly sees the open sky: nothing is wrong, but it is said, because it may be unexpected.
[[nodiscard]] std::optional<std::string> openSkyNotice(const RunReport& report);
/// "tool.hidden" from three tenths on. @param share  of the tool
[[nodiscard]] std::optional<Warning> hiddenToolWarning(double share);
[[nodiscard]] std::vector<Warning> findImplausible(const RunFacts& facts);

}  // namespace accessvdb::tools
