// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which tables to make, and how.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "accessvdb/params.h"
#include "eval/observer.h"

namespace accessvdb::eval {

struct TableOptions {
  /// Names, "all" (every table but the pine) or "fast" (a few rows, in less than a minute).
  std::vector<std::string> tables;
  BackendKind backend = BackendKind::Auto;
  int threads = 0;                        ///< 0 = all
  ChangeMode change = ChangeMode::Block;  ///< of the product's profile
  /// The product's profile scores one point where the surface is (ScoringParams::point_spacing_m), spaced by the voxel
  /// or the range noise; other points do not count. In the tables of SceneRunner and of the pine.
  bool points_of_surface = false;
  std::filesystem::path scan_folder;     ///< where simulated scans are kept between runs; empty = nowhere
  std::filesystem::path picture_folder;  ///< where pictures of the scenes go; empty = none are made
  Observer observer;
};

}  // namespace accessvdb::eval
