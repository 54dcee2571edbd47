// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "sim/tilt_scenes.h"

#include <cmath>
#include <utility>

#include "accessvdb/error.h"
#include "sim/angles.h"
#include "sim/composite_distance.h"
#include "sim/tessellation.h"

namespace accessvdb::sim {
namespace {

using Box = Eigen::AlignedBox3d;
using Eigen::Vector3d;

// table_underside
constexpr double kTop_m = 0.10, kUnderside_m = 0.03, kLegIn_m = 0.08;
// open_box: inside. Its diagonal, 144 mm, is shorter than the pencil.
constexpr double kInsideX_m = 0.06, kInsideY_m = 0.04, kFloor_m = -0.04, kRim_m = 0.06, kPlate_m = 0.02;
// branch_below
constexpr double kBarY_m = 0.03, kBarZ_m = 0.015, kBarX_m = 0.10, kRoofX_m = 0.07, kGap_m = 0.07;
// cone_well: the floor's radius, and the wall's angle to the vertical
constexpr double kWellFloor_m = 0.015, kWellBottom_m = -0.03, kWellTop_m = 0.05;
// slot: a saw 0.12 m wide passes on edge only, except near the upper and the lower end
constexpr double kSlotY_m = 0.0375, kSlotDepth_m = 0.19, kSlotZ_m = 0.12, kSlotMiddleZ_m = 0.05;

Scene ofBoxes(std::string name, std::string description, std::vector<Box> boxes_W) {
  Scene scene;
  scene.name = std::move(name);
  scene.description = std::move(description);
  scene.distance_note = "closed form of the exact shape";
  for (const Box& box_W : boxes_W) {
    const Tessellation box = tessellateBox(box_W.sizes());
    const auto first = static_cast<std::uint32_t>(scene.mesh.vertices_W.size());
    for (const Eigen::Vector3f& vertex : box.mesh.vertices_W) {
      scene.mesh.vertices_W.emplace_back((vertex.cast<double>() + box_W.center()).cast<float>());
    }
    for (const auto& [a, b, c] : box.mesh.triangles) scene.mesh.triangles.push_back({first + a, first + b, first + c});
    // Rounded to float twice, at no more than twice the box's size.
    const double reach_m = std::max(box_W.min().cwiseAbs().maxCoeff(), box_W.max().cwiseAbs().maxCoeff());
    scene.tessellation_error_m = std::max(scene.tessellation_error_m, box.error_m + std::sqrt(3.0) * 0x1p-24 * reach_m);
  }
  scene.distance = std::make_shared<BoxesDistance>(std::move(boxes_W));
  return scene;
}

Scene tableUnderside() {
  std::vector<Box> boxes_W = {Box(Vector3d(-kTop_m, -kTop_m, kUnderside_m), Vector3d(kTop_m, kTop_m, 0.05))};
  for (const double x : {-kTop_m, kLegIn_m}) {
    for (const double y : {-kTop_m, kLegIn_m}) {
      boxes_W.emplace_back(Vector3d(x, y, -0.05), Vector3d(x + 0.02, y + 0.02, 0.04));
    }
  }
  return ofBoxes("table_underside",
                 "table: slab 0.2 x 0.2 x 0.02 m, its underside 0.08 m above the ends of four legs of 0.02 x 0.02 m at "
                 "its corners",
                 std::move(boxes_W));
}

Scene openBox() {
  const double x = kInsideX_m + kPlate_m, y = kInsideY_m + kPlate_m, low = kFloor_m - kPlate_m;
  return ofBoxes("open_box", "box, open above: 0.12 x 0.08 x 0.1 m inside, plates of 0.02 m",
                 {Box(Vector3d(-x, -y, low), Vector3d(x, y, kFloor_m)),
                  Box(Vector3d(-x, -y, low), Vector3d(-kInsideX_m, y, kRim_m)),
                  Box(Vector3d(kInsideX_m, -y, low), Vector3d(x, y, kRim_m)),
                  Box(Vector3d(-x, -y, low), Vector3d(x, -kInsideY_m, kRim_m)),
                  Box(Vector3d(-x, kInsideY_m, low), Vector3d(x, y, kRim_m))});
}

Scene branchBelow() {
  const double out = kGap_m + kPlate_m;
  return ofBoxes("branch_below",
                 "bar 0.2 x 0.06 x 0.03 m along x, in a U that opens downwards: walls 0.14 m apart from 0.065 m above "
                 "to 0.065 m below the bar's middle, 0.14 m long, plates of 0.02 m",
                 {Box(Vector3d(-kBarX_m, -kBarY_m, -kBarZ_m), Vector3d(kBarX_m, kBarY_m, kBarZ_m)),
                  Box(Vector3d(-kRoofX_m, -out, 0.045), Vector3d(kRoofX_m, out, 0.065)),
                  Box(Vector3d(-kRoofX_m, -out, -0.065), Vector3d(kRoofX_m, -kGap_m, 0.065)),
                  Box(Vector3d(-kRoofX_m, kGap_m, -0.065), Vector3d(kRoofX_m, out, 0.065))});
}

Scene coneWell() {
  const double rim_m = kWellFloor_m + (kWellTop_m - kWellBottom_m) * std::tan(30 * kDegree);
  const std::vector<Eigen::Vector2d> profile_m = {
      {0, -0.05},        {0.09, -0.05}, {0.09, kWellTop_m}, {rim_m, kWellTop_m}, {kWellFloor_m, kWellBottom_m},
      {0, kWellBottom_m}};
  Scene scene;
  scene.name = "cone_well";
  scene.description =
      "cylinder, radius 0.09 m, height 0.1 m, with a conical well from above: 0.08 m deep, walls 30 degrees off the "
      "vertical, floor of radius 0.015 m";
  scene.distance_note = "closed form of the exact shape";
  Tessellation turned = tessellateTurned(profile_m, 2e-6);
  scene.mesh = std::move(turned.mesh);
  scene.tessellation_error_m = turned.error_m;
  scene.distance = std::make_shared<TurnedDistance>(profile_m);
  return scene;
}

Scene slot() {
  const double y = kSlotY_m + kPlate_m;
  return ofBoxes("slot",
                 "two walls 0.075 m apart, 0.19 m long, 0.24 m high, joined by a plate at one end; plates of 0.02 m",
                 {Box(Vector3d(-kPlate_m, -y, -kSlotZ_m), Vector3d(0, y, kSlotZ_m)),
                  Box(Vector3d(-kPlate_m, -y, -kSlotZ_m), Vector3d(kSlotDepth_m, -kSlotY_m, kSlotZ_m)),
                  Box(Vector3d(-kPlate_m, kSlotY_m, -kSlotZ_m), Vector3d(kSlotDepth_m, y, kSlotZ_m))});
}

/// From steeply below to steeply above, so that undersides and the insides of boxes are seen.
BenchmarkScene circled(Scene scene) {
  Helix path;
  path.radius_m = 0.3;
  path.height_begin_m = -0.75;
  path.height_end_m = 0.75;
  path.azimuth_end_rad = 15 * kTurn;
  return {std::move(scene), path, 1000, {}};
}

}  // namespace

std::vector<std::string> tiltSceneNames() {
  return {"table_underside", "open_box", "branch_below", "cone_well", "slot"};
}

std::optional<BenchmarkScene> tiltScene(const std::string& name) {
  if (name == "table_underside") return circled(tableUnderside());
  if (name == "open_box") return circled(openBox());
  if (name == "branch_below") return circled(branchBelow());
  if (name == "cone_well") return circled(coneWell());
  if (name == "slot") return circled(slot());
  return std::nullopt;
}

bool HiddenPart::holds(const Scene& scene, const Eigen::Vector3d& p_W) const {
  constexpr double kCosine = 0.99;
  return box_W.contains(p_W) && (facing.isZero(0) || scene.distance->outwardNormal(p_W).dot(facing) > kCosine);
}

HiddenPart hiddenPart(const std::string& name, double margin_m, double slack_m) {
  const double m = margin_m, s = slack_m;
  if (name == "table_underside") {
    const double reach_m = kLegIn_m - m;
    return {"underside",
            Box(Vector3d(-reach_m, -reach_m, kUnderside_m - s), Vector3d(reach_m, reach_m, kUnderside_m + s)),
            -Vector3d::UnitZ()};
  }
  if (name == "open_box") {
    return {"inside", Box(Vector3d(-kInsideX_m - s, -kInsideY_m - s, kFloor_m - s),
                          Vector3d(kInsideX_m + s, kInsideY_m + s, kRim_m - m))};
  }
  if (name == "branch_below") {
    return {"lower side",
            Box(Vector3d(-kBarX_m + m, -kBarY_m + m, -kBarZ_m - s), Vector3d(kBarX_m - m, kBarY_m - m, -kBarZ_m + s)),
            -Vector3d::UnitZ()};
  }
  if (name == "cone_well") {
    const double side_m = kWellFloor_m / std::sqrt(2.0);
    return {"floor", Box(Vector3d(-side_m, -side_m, kWellBottom_m - s), Vector3d(side_m, side_m, kWellBottom_m + s)),
            Vector3d::UnitZ()};
  }
  if (name == "slot") {
    return {"end of the slot",
            Box(Vector3d(-s, -kSlotY_m + m, -kSlotMiddleZ_m), Vector3d(s, kSlotY_m - m, kSlotMiddleZ_m)),
            Vector3d::UnitX()};
  }
  throw InvalidArgument("sim.scene", name, "has no part that only a tilted tool reaches");
}

}  // namespace accessvdb::sim
