// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "sim/changing_scene.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "accessvdb/error.h"
#include "sim/angles.h"

namespace accessvdb::sim {
namespace {

class MovedDistance final : public SignedDistance {
 public:
  MovedDistance(std::shared_ptr<const SignedDistance> of, const Eigen::Vector3d& offset_W)
      : of_(std::move(of)), offset_W_(offset_W) {}
  [[nodiscard]] double at(const Eigen::Vector3d& p_W) const override { return of_->at(p_W - offset_W_); }
  [[nodiscard]] Eigen::Vector3d outwardNormal(const Eigen::Vector3d& p_W) const override {
    return of_->outwardNormal(p_W - offset_W_);
  }

 private:
  std::shared_ptr<const SignedDistance> of_;
  Eigen::Vector3d offset_W_;
};

/// Of parts that do not overlap: exact outside of all of them.
class NearestDistance final : public SignedDistance {
 public:
  explicit NearestDistance(std::vector<MovedDistance> parts) : parts_(std::move(parts)) {}
  [[nodiscard]] double at(const Eigen::Vector3d& p_W) const override { return nearest(p_W).first; }
  [[nodiscard]] Eigen::Vector3d outwardNormal(const Eigen::Vector3d& p_W) const override {
    return nearest(p_W).second->outwardNormal(p_W);
  }

 private:
  [[nodiscard]] std::pair<double, const MovedDistance*> nearest(const Eigen::Vector3d& p_W) const {
    std::pair<double, const MovedDistance*> least = {std::numeric_limits<double>::infinity(), nullptr};
    for (const MovedDistance& part : parts_) {
      const double distance_m = part.at(p_W);
      if (least.second == nullptr || distance_m < least.first) least = {distance_m, &part};
    }
    return least;
  }
  std::vector<MovedDistance> parts_;
};

constexpr double kBoard_m = 2.0, kBoardDepth_m = 0.1;  // of its front face, from the sensor
constexpr double kChange_s = 30, kGone_s = 36;
constexpr double kSway_m = 0.15, kSway_Hz = 0.5;

ScenePart boxAt(const Eigen::Vector3d& size_m, const Eigen::Vector3d& centre_W, const std::string& name) {
  ScenePart part;
  part.scene = translated(makeBox(size_m, name), centre_W);
  return part;
}

/// A box whose front face is this far before the board's.
ScenePart boxBefore(double gap_m, const Eigen::Vector3d& size_m, const std::string& name) {
  return boxAt(size_m, {kBoard_m - gap_m + 0.5 * size_m.x(), 0, 0}, name);
}

ScenePart during(ScenePart part, double from_s, double until_s) {
  part.from_s = from_s;
  part.until_s = until_s;
  return part;
}

}  // namespace

std::shared_ptr<const SignedDistance> ChangingScene::distanceAt(double stamp_s) const {
  std::vector<MovedDistance> there;
  for (const ScenePart& part : parts) {
    if (part.isThere(stamp_s)) there.emplace_back(part.scene.distance, part.offsetAt_W(stamp_s));
  }
  if (there.empty()) throw InvalidArgument("sim.change", name, "nothing is there at this time");
  return std::make_shared<NearestDistance>(std::move(there));
}

ChangingScene changingScene(const std::string& name, double voxel_size_m) {
  const double v = voxel_size_m;
  ChangingScene scene;
  scene.name = name;
  scene.change_s = kChange_s;
  scene.gone_s = kGone_s;
  scene.parts.push_back(boxAt({kBoardDepth_m, 3, 2}, {kBoard_m + 0.5 * kBoardDepth_m, 0, 0}, "board"));
  scene.first_new = 1;
  if (name == "bar") {
    scene.parts.push_back(during(boxBefore(0.06, {2 * v, 1, 2 * v}, "bar"), kChange_s, kGone_s));
    scene.description = "a bar 2 voxels thick, 6 cm before a board";
  } else if (name == "cable") {
    scene.parts.push_back(during(boxBefore(4 * v, {v, 1, v}, "cable"), kChange_s, kGone_s));
    scene.description = "a cable 1 voxel thick, 4 voxels before a board";
  } else if (name == "person") {
    scene.gone_s = kChange_s + 3;
    ScenePart person = during(boxBefore(0.8, {0.4, 0.5, 1.7}, "person"), kChange_s, scene.gone_s);
    person.offset_W = [](double stamp_s) { return Eigen::Vector3d(0, stamp_s - kChange_s - 1.5, 0); };
    scene.parts.push_back(std::move(person));
    scene.description = "a person, 0.8 m before a board, crosses at 1 m/s";
  } else if (name == "branch") {
    scene.gone_s = kChange_s;
    scene.first_new = 2;
    scene.parts.push_back(during(boxBefore(0.3, {0.04, 1, 0.04}, "branch"), 0, kChange_s));
    scene.description = "a branch 0.3 m before a board is cut";
  } else if (name == "sway") {
    ScenePart branch = boxBefore(0.3, {0.04, 1, 0.04}, "branch");
    branch.offset_W = [](double stamp_s) {
      const double swaying_s = std::clamp(stamp_s, kChange_s, kGone_s) - kChange_s;
      return Eigen::Vector3d(0, 0, kSway_m * std::sin(2 * std::numbers::pi * kSway_Hz * swaying_s));
    };
    scene.parts.push_back(std::move(branch));
    scene.description = "a branch 0.3 m before a board sways by 15 cm at 0.5 Hz";
  } else if (name == "car") {
    scene.gone_s = kChange_s + 3;
    ScenePart car = during(boxBefore(1.0, {0.5, 1.6, 0.9}, "car"), 0, scene.gone_s);
    car.scene = translated(car.scene, {0, 0, -0.5});
    car.offset_W = [](double stamp_s) { return Eigen::Vector3d(0, std::max(0.0, stamp_s - kChange_s), 0); };
    scene.parts.push_back(std::move(car));
    scene.description = "a car, 0.5 m before a wall, leaves at 1 m/s";
  } else if (name == "sky") {
    scene.gone_s = kChange_s;
    scene.first_new = 2;
    scene.parts[0] = boxAt({kBoardDepth_m, 3, 0.9}, {kBoard_m + 0.5 * kBoardDepth_m, 0, -0.55}, "low board");
    ScenePart branch = during(boxBefore(0.3, {0.04, 1, 0.04}, "branch"), 0, kChange_s);
    branch.scene = translated(branch.scene, {0, 0, 0.25});
    scene.parts.push_back(std::move(branch));
    scene.description = "a branch with open sky behind it, above a board, is cut";
  } else {
    std::string known;
    for (const std::string& each : changingSceneNames()) known += (known.empty() ? "" : ", ") + each;
    throw InvalidArgument("sim.scene", name, "is not a scene that changes", "Use one of " + known);
  }
  // Ten scans a second; the sensor sways by a few centimetres, as in a hand. Pitched so that the Mid-360 sees the
  // board.
  for (int n = 0; n < 480; ++n) {
    Eigen::Isometry3d T_W_S = Eigen::Isometry3d::Identity();
    const double t = 0.1 * n;
    T_W_S.linear() = Eigen::AngleAxisd(22.5 * kDegree, Eigen::Vector3d::UnitY()).toRotationMatrix();
    T_W_S.translation() = Eigen::Vector3d(0.03 * std::sin(0.9 * t), 0.05 * std::sin(0.7 * t), 0.03 * std::sin(1.3 * t));
    scene.trajectory.push_back(T_W_S);
  }
  return scene;
}

std::vector<std::string> changingSceneNames() { return {"bar", "cable", "person", "branch", "sway", "car", "sky"}; }

}  // namespace accessvdb::sim
