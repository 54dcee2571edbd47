// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// One run of the method on one scene, together with its ground truth.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "accessvdb/params.h"
#include "accessvdb/types.h"
#include "eval/confusion.h"
#include "eval/scan_store.h"

namespace accessvdb::eval {

struct RunRequest {
  ScanRequest scans;
  FieldParams params;
  std::string tool = "builtin:pencil";
  int update_every = 0;       ///< scans between updates; 0 = one at the end
  bool true_normals = false;  ///< also compare with the truth for the scene's own normals
};

/// The paper's constants at this voxel size, or the product's. The range noise passed to the product is the one in the
/// scans, as `simulate` writes it next to them.
[[nodiscard]] RunRequest paperRun(const std::string& scene, double voxel_size_m);
[[nodiscard]] RunRequest productRun(const std::string& scene, double voxel_size_m, double range_noise_m = 0);

/// FieldParams::scoring.point_spacing_m as `map --points surface` sets it.
[[nodiscard]] double surfaceSpacing_m(const FieldParams& params);

/// Points that count (c not below the bound, not beside the surface), with labels and truth; vectors of equal length.
struct EvaluatedRun {
  std::vector<Eigen::Vector3d> positions_W;
  std::vector<Eigen::Vector3f> normals_W;     ///< the method's own
  std::vector<std::uint8_t> found;            ///< 1 = labelled accessible
  std::vector<std::uint8_t> truth_shared;     ///< 1 = really accessible, judged with the method's own normal (paper)
  std::vector<std::uint8_t> truth_exact;      ///< ... with the scene's normal; empty unless requested
  std::vector<Eigen::Vector3d> viewpoints_W;  ///< sensor positions, one per frame
  std::uint64_t all_points = 0;               ///< including those below the bound
  std::array<std::uint64_t, kNumPointReasons> reasons = {};  ///< over all points
  std::uint64_t returns = 0;
  std::uint64_t distance_updates = 0;  ///< (return, voxel) pairs fused
  std::uint64_t direction_tests = 0;
  std::uint64_t labels_unlike_scratch = 0;  ///< labels that differ from a from-scratch evaluation of the final map
  double fuse_s = 0, update_s = 0, truth_s = 0;

  [[nodiscard]] Confusion shared() const { return compare(truth_shared, found); }
  [[nodiscard]] Confusion exact() const { return compare(truth_exact, found); }
};

/// Runs requests and caches the results: tables share many.
class SceneRunner {
 public:
  /// @param backend, threads  as in FieldParams  @param change  of runs whose parameters allow it
  /// @param points_of_surface  TableOptions::points_of_surface, likewise
  SceneRunner(ScanStore& scans, BackendKind backend, int threads, Observer observer,
              ChangeMode change = ChangeMode::Block, bool points_of_surface = false);

  /// @throws StopRequested, InvalidArgument (scene), what the library throws
  std::shared_ptr<const EvaluatedRun> run(RunRequest request);
  /// AccessibilityField::deviceName() of the last field; empty before the first.
  [[nodiscard]] const std::string& device() const { return device_; }

 private:
  ScanStore& scans_;
  BackendKind backend_;
  int threads_;
  Observer observer_;
  ChangeMode change_;
  bool points_of_surface_;
  std::string device_;
  std::map<std::string, std::shared_ptr<const EvaluatedRun>> runs_;
};

}  // namespace accessvdb::eval
