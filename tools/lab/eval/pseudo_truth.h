// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Pseudo ground truth: labels from the sparse half of a recording, judged by what its dense half shows of the world.
///
/// The definition is that of exact truth (ground_truth.h): the tool over every direction, at the stored position and
/// with the stored normal of each point. Only the world is another one: in place of a scene's exact distance stands the
/// DenseView of returns that the judged map never had. So the method's own errors, and its caution about what it has
/// not seen, are not shared.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "accessvdb/params.h"
#include "accessvdb/scan_io.h"
#include "accessvdb/tool_geometry.h"
#include "eval/confusion.h"
#include "eval/dense_view.h"
#include "eval/ground_truth.h"
#include "eval/observer.h"
#include "eval/table_row.h"

namespace accessvdb::eval {

/// Undecided: the point would be accessible if what the dense half did not see were empty, and blocked if it were full.
enum class PseudoVerdict : std::uint8_t { Accessible, Blocked, NoSurface, Undecided };

/// @param normals_W  [n] unit; zero = none, then no direction is in the cone
/// @return [n]
[[nodiscard]] std::vector<PseudoVerdict> judgeBy(const DenseView& view, const ToolGeometry& tool,
                                                 const TruthOptions& options,
                                                 std::span<const Eigen::Vector3d> positions_W,
                                                 std::span<const Eigen::Vector3d> normals_W);

/// Scans: every second scan is of the sparse half. Returns: every second return, drawn by lot; for a single scan.
enum class HalvesBy : std::uint8_t { Scans, Returns };

struct PseudoTruthRequest {
  std::string name;       ///< for messages
  std::size_t scans = 0;  ///< how many there are
  std::function<io::ScanRecord(std::size_t)> read;
  FieldParams params;        ///< of the map that is judged
  double range_noise_m = 0;  ///< of the sensor, whatever the judged map takes it to be
  HalvesBy halves = HalvesBy::Scans;
  std::vector<double> densities = {1, 1.0 / 4, 1.0 / 16};  ///< shares of the sparse half's returns, (0, 1]
  std::size_t most_judged =
      20000;  ///< points of a map, evenly spread over all; their figures are accurate to 0.7 points
};

/// One density of the sparse half.
struct PseudoTruthRun {
  double density = 1;
  std::uint64_t returns = 0, points = 0;  ///< of the sparse map; points that count (EvaluatedRun)
  std::vector<Eigen::Vector3d> positions_W, normals_W;
  std::vector<std::uint8_t> found;      ///< 1 = labelled accessible
  std::vector<PseudoVerdict> verdicts;  ///< all four are of equal length

  [[nodiscard]] Confusion judged() const;
  [[nodiscard]] double percentOf(PseudoVerdict verdict) const;
};

struct PseudoTruthResult {
  std::uint64_t dense_returns = 0;
  std::vector<PseudoTruthRun> runs;  ///< one for each density
  FieldParams params;                ///< resolved
  std::string device;
};

/// Reads the scans once for the dense half and once for each density.
/// @throws UnusableInput "pseudo_truth.scans" (nothing to split), "pseudo_truth.nothing" (no point can be judged);
/// InvalidArgument "pseudo_truth.density"; StopRequested, what the library throws
[[nodiscard]] PseudoTruthResult pseudoTruth(const PseudoTruthRequest& request, const ToolGeometry& tool,
                                            const Observer& observer);

/// The plain alternative, for comparison: the label that the method gives the point of the dense half in the same
/// voxel. NoSurface where there is none. What the method does wrong in both halves alike is not found so.
[[nodiscard]] std::vector<PseudoVerdict> verdictsOfLabels(const PseudoTruthRequest& request, const ToolGeometry& tool,
                                                          const Observer& observer,
                                                          std::span<const Eigen::Vector3d> positions_W);

/// Table "pseudo_truth": the figures of judged points, and how many were not judged and why.
[[nodiscard]] TableRow pseudoTruthRow(const std::string& scene, TableColumn column, double voxel_m,
                                      const PseudoTruthRun& run);

}  // namespace accessvdb::eval
