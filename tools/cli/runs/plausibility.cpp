// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "runs/plausibility.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <utility>

#include "options/options.h"

namespace accessvdb::tools {
namespace {

constexpr std::size_t kReturnsSampled = 2000;  // per scan: enough for shares to within a few per cent
constexpr std::size_t kMostCells = 4'000'000;  // bounds the memory of the overlap test
constexpr std::size_t kMostRanges = 1'000'000;

constexpr double kCell_m = 0.5;      // coarse enough that neighbouring scans of a surface share cells
constexpr double kOverlapMin = 0.1;  // moving sensors share far more than this, wrong poses almost nothing
constexpr double kDroppedMax = 0.5;  // a Mid-360 drops 28 % as "no return" in normal operation
constexpr double kHiddenMax = 0.3;
constexpr double kRangeMax_m = 500;   // no ranging sensor of this kind sees farther: likely millimetres
constexpr double kRangeMin_m = 0.05;  // nor is its scene this near
constexpr double kHandToolMax_m = 3;  // robot tools are smaller; a tool in mm read as cm is ten times larger
constexpr double kToolMin_m = 0.01;
constexpr double kStepMax = 0.1;     // voxels between coordinates: coarser ones move surfaces
constexpr double kWorldMax_m = 1e5;  // map projections start here

std::string percent(double share) {
  char text[16];
  std::snprintf(text, sizeof text, "%.0f %%", 100 * share);
  return text;
}

/// Between coordinates as 32-bit floats, at a point.
double floatStepAt(const Eigen::Vector3d& p) {
  const auto size = static_cast<float>(p.cwiseAbs().maxCoeff());
  return std::nextafter(size, std::numeric_limits<float>::infinity()) - size;
}

bool fitsFloats(const Eigen::Vector3d& p) { return p.cast<float>().cast<double>() == p; }

std::uint64_t cellOf(const Eigen::Vector3d& p_W) {
  std::uint64_t key = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const auto index = static_cast<std::int64_t>(std::floor(std::clamp(p_W[axis] / kCell_m, -1e9, 1e9)));
    key = (key ^ static_cast<std::uint64_t>(index)) * 0x9e3779b97f4a7c15ULL;
    key ^= key >> 29;
  }
  return key;
}

double medianOf(std::vector<double> values) {
  if (values.empty()) return -1;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// What helps where no point is accessible.
std::string adviceFor(PointReason reason, bool level_approaches) {
  if (reason == PointReason::Confidence) return "Use more scans, so that surfaces are observed more often";
  if (reason == PointReason::Changed) return "What was there has gone: map without --change full, or use later scans";
  if (level_approaches && (reason == PointReason::Unseen || reason == PointReason::Normal)) {
    return "The tool comes from the side only, in level directions: let it tilt with --orientations, for example "
           "sphere:20";
  }
  if (reason == PointReason::Unseen || reason == PointReason::Normal || reason == PointReason::Unknown) {
    return "Use scans from more sides, from where the tool would come";
  }
  return "Check the tool's tip, axis and unit (accessvdb render --tool shows them)";
}

}  // namespace

void SceneStatistics::addReturn(const Eigen::Vector3d& origin_W, const Eigen::Vector3d& p_W) {
  sensors_W_.extend(origin_W);
  if (ranges_m_.size() < kMostRanges) ranges_m_.push_back(static_cast<float>((p_W - origin_W).norm()));
}

void SceneStatistics::addStep(const io::ScanRecord& record) {
  std::vector<double> steps_m;
  bool floats = true;  // all of them, by chance only where the steps are small
  const auto look = [&](const Eigen::Vector3d& p) {
    if (!p.allFinite() || p.isZero(0)) return;
    floats = floats && fitsFloats(p);
    steps_m.push_back(floatStepAt(p));
  };
  const std::size_t rays = record.points_W.size(), count = record.points_S.size();
  for (std::size_t i = 0; i < rays; i += std::max<std::size_t>(1, rays / kReturnsSampled)) look(record.points_W[i]);
  for (std::size_t i = 0; i < count; i += std::max<std::size_t>(1, count / kReturnsSampled))
    look(record.points_S[i].cast<double>());
  if (steps_m.empty()) return;
  float_steps_m_.push_back(floats ? medianOf(std::move(steps_m)) : 0);
  file_steps_m_.push_back(record.step_m);
}

void SceneStatistics::add(const io::ScanRecord& record) {
  addStep(record);
  const std::size_t rays = record.points_W.size();
  for (std::size_t i = 0; i < rays; i += std::max<std::size_t>(1, rays / kReturnsSampled)) {
    const Eigen::Vector3d& origin_W = record.origins_W.size() == 1 ? record.origins_W[0] : record.origins_W.at(i);
    if (record.points_W[i].allFinite() && origin_W.allFinite() && record.points_W[i] != origin_W)
      addReturn(origin_W, record.points_W[i]);
  }
  const std::size_t count = record.points_S.size();
  if (count == 0) return;
  std::vector<std::uint64_t> cells;
  for (std::size_t i = 0; i < count; i += std::max<std::size_t>(1, count / kReturnsSampled)) {
    const Eigen::Vector3f& p_S = record.points_S[i];
    if (!p_S.allFinite() || p_S.isZero(0)) continue;
    const Eigen::Vector3d p_W = record.T_W_S * p_S.cast<double>();
    addReturn(record.T_W_S.translation(), p_W);
    cells.push_back(cellOf(p_W));
  }
  if (cells.empty()) return;
  if (!seen_cells_.empty()) {
    const auto known =
        std::count_if(cells.begin(), cells.end(), [&](std::uint64_t cell) { return seen_cells_.count(cell) > 0; });
    overlaps_.push_back(static_cast<double>(known) / static_cast<double>(cells.size()));
  }
  if (seen_cells_.size() < kMostCells) seen_cells_.insert(cells.begin(), cells.end());
}

double SceneStatistics::medianRange_m() const {
  return std::max(0.0, medianOf(std::vector<double>(ranges_m_.begin(), ranges_m_.end())));
}

double SceneStatistics::floatStep_m() const { return std::max(0.0, medianOf(float_steps_m_)); }
double SceneStatistics::fileStep_m() const { return std::max(0.0, medianOf(file_steps_m_)); }

double SceneStatistics::medianOverlap() const { return medianOf(overlaps_); }

std::optional<Warning> toolUnitWarning(const Eigen::Vector3d& size_m) {
  const double tool_m = size_m.maxCoeff();
  if (tool_m <= kHandToolMax_m && tool_m >= kToolMin_m) return std::nullopt;
  return Warning{"tool.unit", "the tool is " + numberText(tool_m) +
                                  " m long: it looks like a mesh read in the wrong unit. Check --tool-unit"};
}

std::optional<std::string> openSkyNotice(const RunReport& report) {
  const auto empty = static_cast<double>(report.dropped[static_cast<int>(DropReason::NoReturn)]);
  const auto rays = static_cast<double>(report.points_in);
  if (!(empty > kDroppedMax * rays)) return std::nullopt;
  return percent(empty / rays) + " of the rays came back from nowhere (no_return), as those into the open sky do";
}

std::optional<Warning> hiddenToolWarning(double share) {
  if (!(share > kHiddenMax)) return std::nullopt;
  return Warning{"tool.hidden", percent(share) +
                                    " of the tool is so near its tip that collisions there are not counted "
                                    "(self-exclusion, 3 voxels). Use a smaller --voxel for this tool"};
}

std::vector<Warning> findImplausible(const RunFacts& facts) {
  std::vector<Warning> found;
  const auto warn = [&](const char* id, const std::string& text) { found.push_back({id, text}); };
  const RunReport& report = facts.report;
  const std::uint64_t accessible = report.labels[static_cast<int>(PointLabel::Accessible)];
  const std::uint64_t blocked = report.labels[static_cast<int>(PointLabel::Blocked)];

  if (accessible + blocked == 0) {
    warn("result.nothing_scored",
         "no surface point was observed often enough to be scored. Use more scans, a larger "
         "--voxel, or check that scans and poses belong together");
  } else if (accessible == 0) {
    // Points beside the surface are left to others, whatever stops those.
    const auto end = report.reasons.begin() + static_cast<std::ptrdiff_t>(PointReason::BesideSurface);
    const auto worst = std::max_element(report.reasons.begin() + 1, end) - report.reasons.begin();
    warn("result.all_blocked", std::string("no point is accessible; the most frequent reason is \"") +
                                   name(static_cast<PointReason>(worst)) + "\". " +
                                   adviceFor(static_cast<PointReason>(worst), facts.level_approaches));
  }

  // Where nothing came back there is nothing to drop.
  std::array<std::uint64_t, kNumDropReasons> dropped_for = report.dropped;
  const std::uint64_t returns =
      report.points_in - std::exchange(dropped_for[static_cast<int>(DropReason::NoReturn)], 0);
  std::uint64_t dropped = 0;
  for (const std::uint64_t count : dropped_for) dropped += count;
  if (returns > 0 && static_cast<double>(dropped) > kDroppedMax * static_cast<double>(returns)) {
    const auto worst = std::max_element(dropped_for.begin(), dropped_for.end()) - dropped_for.begin();
    warn("input.most_dropped", percent(static_cast<double>(dropped) / static_cast<double>(returns)) +
                                   " of the returns were dropped, most of them as \"" +
                                   name(static_cast<DropReason>(worst)) +
                                   "\". Check --min-range, --max-range and the scans");
  }

  if (report.contradicted_platforms > 0) {
    warn("platform.contradicted", "around " + std::to_string(report.contradicted_platforms) +
                                      " sensor positions something lies within --platform-radius, so nothing was "
                                      "cleared there. Use a smaller one, or leave the platform's own returns out with "
                                      "--min-range");
  }

  const double range_m = facts.scene.medianRange_m();
  const Eigen::AlignedBox3d& sensors_W = facts.scene.sensors_W();
  const double path_m = sensors_W.isEmpty() ? 0 : sensors_W.diagonal().norm();
  if (range_m > kRangeMax_m) {
    warn("input.scan_unit", "half of the returns are more than " + numberText(range_m) +
                                " m away: the scans look like millimetres. Scans must be in metres");
  } else if (range_m > 0 && range_m < kRangeMin_m) {
    warn("input.scan_unit", "half of the returns are nearer than " + numberText(range_m) +
                                " m: the scans look like kilometres. Scans must be in metres");
  } else if (range_m > 0 && path_m > 1000 * range_m) {
    warn("input.pose_unit", "the sensor travels " + numberText(path_m) + " m but sees only " + numberText(range_m) +
                                " m far: the poses look like millimetres. Poses must be in metres");
  }
  const double float_m = facts.scene.floatStep_m(), file_m = facts.scene.fileStep_m();
  // Whichever is coarser has made the other.
  if (const double step_m = std::max(float_m, file_m); step_m > kStepMax * facts.voxel_size_m) {
    warn("scans.coarse",
         "coordinates come in steps of " + numberText(step_m) + " m, " + numberText(step_m / facts.voxel_size_m) +
             " voxels" +
             (float_m >= file_m ? ": 32-bit floats cannot tell more so far from zero. Export them in "
                                  "double precision, or subtract an origin before they are saved"
                                : ", as the file's scale says. Export them with a finer scale, or use a "
                                  "larger --voxel"));
  }
  const double overlap = facts.scene.medianOverlap();
  if (overlap >= 0 && overlap < kOverlapMin) {
    warn("input.no_overlap",
         "scans hardly overlap: in the median scan only " + percent(overlap) +
             " of the returns fall where an earlier scan saw something. Check that the poses are those "
             "of the sensor, in the right frame and order (--pose-format, --calib)");
  }

  if (!facts.surface_W.isEmpty()) {
    const double scene_m = facts.surface_W.diagonal().norm();
    if (facts.tool_reach_m > scene_m) {
      warn("tool.larger_than_scene", "the tool reaches " + numberText(facts.tool_reach_m) +
                                         " m, the whole scene measures " + numberText(scene_m) +
                                         " m. Check --tool-unit");
    }
    const Eigen::Vector3d far = (facts.surface_W.min() - facts.origin_W)
                                    .cwiseAbs()
                                    .cwiseMax((facts.surface_W.max() - facts.origin_W).cwiseAbs());
    // Points are kept in single precision relative to the origin; up to a tenth of a voxel may be lost.
    if (far.maxCoeff() * 0x1p-24 > 0.1 * facts.voxel_size_m) {
      warn("scene.too_wide",
           "the scene reaches " + numberText(far.maxCoeff()) +
               " m from its origin, where positions are coarser than a tenth of a voxel. Check the poses, "
               "or map it in parts");
    }
    const double world_m = facts.surface_W.min().cwiseAbs().cwiseMax(facts.surface_W.max().cwiseAbs()).maxCoeff();
    if (world_m > kWorldMax_m) {
      warn("scene.huge_coordinates", "coordinates reach " + numberText(world_m) +
                                         " m (a map projection?). The .vdb files are relative to the origin in their "
                                         "metadata, points.ply keeps world coordinates in double precision");
    }
  }
  if (const auto warning = toolUnitWarning(facts.tool_size_m)) found.push_back(*warning);
  return found;
}

}  // namespace accessvdb::tools
