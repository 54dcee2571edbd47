// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Scenes in which something appears, goes or is cut: how soon the map follows, and what stays behind.
///
/// The reference is a fresh map of the scans since the change alone. Points: what it calls blocked, by the tool or the
/// arm, the map that was there before must not call accessible; and what it calls accessible after the thing has gone,
/// the map should. Voxels: those near the new thing that collide in the fresh map should collide in the old one.
#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/tsdf_volume.h"
#include "eval/ground_truth.h"
#include "eval/table_context.h"
#include "sim/changing_scene.h"
#include "sim/simulator.h"

namespace accessvdb::eval {
namespace {

constexpr double kVoxel_m = 0.02, kTau_m = 0.1, kNoise_m = 0.005;
/// Scans since the change after which the maps are compared.
constexpr std::array kScansAfter = {3, 5, 10, 30};
constexpr int kScansAfterGone[] = {10, 40};
/// Of the points that a fresh map blocks, those still called accessible 10 scans later; for things 2 voxels wide.
constexpr double kMostStillAccessible_percent = 5;

FieldParams paramsOf(const TableContext& context, ChangeMode mode) {
  FieldParams params;
  params.tsdf.voxel_size_m = kVoxel_m;
  params.tsdf.truncation_distance_m = kTau_m;
  params.tsdf.range_noise_m = kNoise_m;
  params.scoring.max_collisions = 1;  // a thin thing touches few voxels of the tool: by the rule, it might not count
  params.change.mode = mode;
  params.origin_W = {{0, 0, 0}};  // the same voxels in every map
  params.backend = context.options.backend;
  params.threads = context.options.threads;
  return params;
}

AccessibilityField makeField(const TableContext& context, ChangeMode mode) {
  return AccessibilityField(ToolGeometry::builtin("builtin:pruner"), paramsOf(context, mode));
}

double percent(std::size_t part, std::size_t whole) {
  return whole > 0 ? 100 * static_cast<double>(part) / static_cast<double>(whole) : 0;
}

/// Of the points of `fresh` that are `wanted`, the share that `found` holds of in the same voxel of `map`.
template <typename Wanted, typename Found>
double shareOf(const FieldSnapshot& fresh, const AccessibilityField& map, const Wanted& wanted, const Found& found,
               std::size_t* count = nullptr) {
  std::size_t all = 0, hits = 0;
  for (const SurfacePoint& point : fresh.points) {
    if (!wanted(point)) continue;
    ++all;
    const auto here = map.pointAt(point.position_W);
    hits += here && found(*here) ? 1 : 0;
  }
  if (count != nullptr) *count = all;
  return percent(hits, all);
}

bool isAccessible(const SurfacePoint& point) { return point.label == PointLabel::Accessible; }
bool isInTheWay(const SurfacePoint& point) {
  return point.label == PointLabel::Blocked && (point.reason == PointReason::Tool || point.reason == PointReason::Arm);
}

/// Colliding voxels within a voxel of a part's surface; and how many of them do not collide in another map.
struct NearVoxels {
  std::size_t colliding = 0, free_elsewhere = 0;
};
NearVoxels voxelsNear(const sim::ChangingScene& scene, double stamp_s, const AccessibilityField& fresh,
                      const AccessibilityField& map) {
  NearVoxels near;
  const auto r_c = static_cast<float>(map.params().scoring.collision_distance_m);
  const auto distances = fresh.volume().distance();
  for (auto voxel = distances->cbeginValueOn(); voxel; ++voxel) {
    if (*voxel >= r_c) continue;
    const openvdb::Coord ijk = voxel.getCoord();
    const Eigen::Vector3d p_W = kVoxel_m * Eigen::Vector3d(ijk.x(), ijk.y(), ijk.z());  // the origin is 0, 0, 0
    const bool is_near = std::any_of(
        scene.parts.begin() + static_cast<std::ptrdiff_t>(scene.first_new), scene.parts.end(), [&](const auto& part) {
          return part.isThere(stamp_s) && part.scene.distance->at(p_W - part.offsetAt_W(stamp_s)) <= kVoxel_m;
        });
    if (!is_near) continue;
    ++near.colliding;
    const VoxelState state = map.volume().at(ijk);
    near.free_elsewhere += state.weight > 0 && state.distance_m < r_c ? 0 : 1;
  }
  return near;
}

/// Labels against what is really there at a time.
Confusion againstTruth(const AccessibilityField& field, const sim::ChangingScene& scene, double stamp_s) {
  std::vector<Eigen::Vector3d> positions_W, normals_W;
  std::vector<std::uint8_t> found;
  for (const SurfacePoint& point : field.snapshot().points) {
    if (point.label == PointLabel::Unscored) continue;
    positions_W.push_back(point.position_W);
    normals_W.emplace_back(point.normal_W.cast<double>());
    found.push_back(isAccessible(point) ? 1 : 0);
  }
  const GroundTruth truth(scene.distanceAt(stamp_s), field.tool(), truthOptions(field.params()));
  return compare(truth.accessible(positions_W, normals_W), found);
}

/// Fuses the same scans into the old map and a fresh one.
class Follow {
 public:
  Follow(TableContext& context, const sim::Simulator& simulator, ChangeMode mode)
      : context_(context), simulator_(simulator), mode_(mode), old_(makeField(context, mode)) {}

  void fuseUntil(int scan) {
    for (; next_ < scan && next_ < simulator_.frames(); ++next_) {
      context_.options.observer.checkStop();
      const sim::SimulatedFrame frame = simulator_.frame(next_);
      old_.integrateScan(frame.points_S, frame.T_W_S, frame.stamp_s);
      if (fresh_) fresh_->integrateScan(frame.points_S, frame.T_W_S, frame.stamp_s);
    }
    old_.update();
    if (fresh_) fresh_->update();
  }
  void startFresh() { fresh_ = std::make_unique<AccessibilityField>(makeField(context_, mode_)); }
  [[nodiscard]] const AccessibilityField& old() const { return old_; }
  [[nodiscard]] FieldSnapshot fresh() const { return fresh_->snapshot(); }
  [[nodiscard]] const AccessibilityField& freshField() const { return *fresh_; }

 private:
  TableContext& context_;
  const sim::Simulator& simulator_;
  ChangeMode mode_;
  AccessibilityField old_;
  std::unique_ptr<AccessibilityField> fresh_;
  int next_ = 0;
};

TableRow changeRow(TableContext& context, const std::string& name, ChangeMode mode) {
  const sim::ChangingScene scene = sim::changingScene(name, kVoxel_m);
  sim::LidarModel model = sim::LidarModel::named("mid360");
  model.range_noise_m = kNoise_m;
  const sim::Simulator simulator(scene, model, 1);
  const auto scanAt = [&](double stamp_s) { return static_cast<int>(std::lround(stamp_s / model.frame_period_s)); };
  TableRow row;
  row.table = "change";
  row.scene = name;
  row.method = "product";
  row.variant = mode == ChangeMode::Off ? "off" : "block";
  row.voxel_m = kVoxel_m;

  Follow follow(context, simulator, mode);
  context.device = follow.old().deviceName();
  const int change = scanAt(scene.change_s), gone = scanAt(scene.gone_s);
  follow.fuseUntil(change);
  if (gone > change) {
    follow.startFresh();
    for (const int after : kScansAfter) {
      if (change + after > gone) break;
      follow.fuseUntil(change + after);
      std::size_t to_block = 0;
      const double still = shareOf(follow.fresh(), follow.old(), isInTheWay, isAccessible, &to_block);
      row.more.emplace_back("still_accessible_percent_after_" + std::to_string(after), still);
      if (after != 10) continue;
      row.more.emplace_back("points_to_block", static_cast<double>(to_block));
      const double stamp_s = (change + after - 1) * model.frame_period_s;
      const NearVoxels near = voxelsNear(scene, stamp_s, follow.freshField(), follow.old());
      row.more.emplace_back("voxels_still_free_percent_after_10", percent(near.free_elsewhere, near.colliding));
      row.more.emplace_back("voxels_to_block", static_cast<double>(near.colliding));
      row.figures = againstTruth(follow.old(), scene, stamp_s);
      // What is thinner, or moves along what it leaves behind, is stated apart.
      const bool measured = name == "bar" || name == "person";
      if (mode == ChangeMode::Block && measured) row.must_hold = still <= kMostStillAccessible_percent;
    }
    follow.fuseUntil(gone);
  }
  follow.startFresh();
  for (const int after : kScansAfterGone) {
    follow.fuseUntil(gone + after);
    const double ghosts =
        shareOf(follow.fresh(), follow.old(), isAccessible, [](const SurfacePoint& p) { return !isAccessible(p); });
    row.more.emplace_back("ghosts_percent_" + std::to_string(after) + "_after_gone", ghosts);
  }
  if (gone == change) row.figures = againstTruth(follow.old(), scene, (gone + 39) * model.frame_period_s);
  return row;
}

}  // namespace

void makeChangeTable(TableContext& context) {
  for (const std::string& name : sim::changingSceneNames()) {
    for (const ChangeMode mode : {ChangeMode::Off, ChangeMode::Block}) {
      context.options.observer.say("change: " + name + (mode == ChangeMode::Off ? ", off" : ", block"));
      context.rows.push_back(changeRow(context, name, mode));
    }
  }
  makeCutRows(context);
  drawFilms(context);
}

}  // namespace accessvdb::eval
