// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Scenes with surfaces that a level tool cannot reach and a tilted one can (docs/PAPER.md, "Scenes for tilted tools").
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "sim/benchmark_scene.h"

namespace accessvdb::sim {

/// "table_underside", "open_box", "branch_below", "cone_well", "slot"
[[nodiscard]] std::vector<std::string> tiltSceneNames();
/// Scene and path; the poses are not generated yet. Nothing for any other name.
[[nodiscard]] std::optional<BenchmarkScene> tiltScene(const std::string& name);

/// Where only a tool that tilts or rolls comes to: points inside box_W whose outward normal is facing, or any if zero.
/// Farther than margin_m from edges, where normals turn and the tool's tip, which may touch, reaches around them.
struct HiddenPart {
  std::string words;  ///< "underside"
  Eigen::AlignedBox3d box_W;
  Eigen::Vector3d facing = {0, 0, 0};

  [[nodiscard]] bool holds(const Scene& scene, const Eigen::Vector3d& p_W) const;
};
/// Of a scene of tiltScene(). @param slack_m  how far points may be from the surface
[[nodiscard]] HiddenPart hiddenPart(const std::string& name, double margin_m, double slack_m);

}  // namespace accessvdb::sim
