// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Approaches that are proposed, judged by the exact scene: are their poses free, also with their room, and how much of
/// what is accessible do they cover?
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/approaches.h"
#include "accessvdb/tool_spec.h"
#include "eval/action_scenes.h"
#include "eval/ground_truth.h"
#include "eval/table_context.h"

namespace accessvdb::eval {
namespace {

/// Poses of one kind, and how many of them are free in truth.
struct Judged {
  double poses = 0, free = 0;
  [[nodiscard]] double percent() const { return poses > 0 ? 100 * free / poses : 0; }
};

class Judge {
 public:
  /// With ten times as many samples as the truth of labels, and the same share of them as its limit: in a crown, two
  /// sets of its samples agree about 96 % of the poses only.
  Judge(std::shared_ptr<const sim::SignedDistance> distance, const ToolGeometry& tool, const TruthOptions& options)
      : distance_(std::move(distance)), tool_(tool), options_(options) {
    constexpr int kTimes = 10;
    options_.surface_samples *= kTimes;
    options_.collision_limit *= kTimes;
  }

  /// In contact: as the truth of labels, with room around the tool.
  void contact(const Eigen::Isometry3d& T_WT, double margin_m, Judged& judged) const {
    TruthOptions options = options_;
    options.margin_m = margin_m;
    count(T_WT, options, judged);
  }
  /// Elsewhere: no part of the tool is inside anything.
  void apart(const Eigen::Isometry3d& T_WT, Judged& judged) const {
    TruthOptions options = options_;
    options.arm_m.clear();
    options.self_exclusion_m = -1;
    options.collision_distance_m = 0;
    options.collision_limit = 1;
    count(T_WT, options, judged);
  }

 private:
  void count(const Eigen::Isometry3d& T_WT, TruthOptions options, Judged& judged) const {
    options.orientations = {T_WT.linear()};
    judged.poses += 1;
    judged.free += GroundTruth(distance_, tool_, options).free(T_WT.translation(), 0) ? 1 : 0;
  }

  std::shared_ptr<const sim::SignedDistance> distance_;
  const ToolGeometry& tool_;
  TruthOptions options_;
};

}  // namespace

void addApproachRow(TableContext& context, const AccessibilityField& field,
                    const std::shared_ptr<const sim::SignedDistance>& distance, const std::string& scene,
                    const ApproachOptions& options, double least_contact_percent) {
  const double v = field.params().tsdf.voxel_size_m;
  const bool allow_unknown = options.allow_unknown;
  const Approaches found = approaches(field, options);
  const Judge judge(distance, field.tool(), truthOptions(field.params()));
  Judged contact, with_room, apart;
  for (const ApproachTarget& target : found.targets) {
    for (const ApproachPath& path : target.approaches) {
      judge.contact(path.contact_T_WT, 0, contact);
      judge.contact(path.contact_T_WT, static_cast<double>(target.margin_m), with_room);
      judge.apart(path.pre_contact_T_WT, apart);
      judge.apart(path.retreat_T_WT, apart);
    }
  }
  TableRow row;
  row.table = "approaches";
  row.scene = scene;
  row.method = "product";
  row.variant = allow_unknown ? "unknown allowed" : "known free";
  row.voxel_m = v;
  row.more = {
      {"targets", static_cast<double>(found.targets.size())},
      {"contact_free_percent", contact.percent()},
      {"with_room_free_percent", with_room.percent()},
      {"before_and_after_free_percent", apart.percent()},
      {"covered_percent",
       found.accessible > 0 ? 100 * static_cast<double>(found.covered) / static_cast<double>(found.accessible) : 0}};
  row.must_hold = 100 * contact.free >= least_contact_percent * contact.poses && apart.free == apart.poses;
  context.rows.push_back(row);
  char line[240];
  std::snprintf(
      line, sizeof line,
      "%s at %g mm, %s: %zu targets, contact %.2f %%, with room %.2f %%, before and after %.2f %%, covers %.1f %%",
      scene.c_str(), 1000 * v, row.variant.c_str(), found.targets.size(), contact.percent(), with_room.percent(),
      apart.percent(), row.more.back().second);
  context.options.observer.say(line);
}

void makeApproachesTable(TableContext& context) {
  const ToolGeometry pencil = ToolGeometry::builtin("builtin:pencil");
  for (const char* scene : {"torus", "sphere_a", "table_underside", "open_box", "branch_below", "cone_well"}) {
    ScanRequest request;
    request.scene = scene;
    request.voxel_size_m = 0.005;
    const std::shared_ptr<const StoredScans> scans = context.scans.get(request);
    AccessibilityField field(withMargins({{pencil}}, {0.02, 0.05}), clearedParams(context, request.voxel_size_m));
    context.device = field.deviceName();
    for (const StoredFrame& frame : scans->frames) {
      context.options.observer.checkStop();
      (void)field.integrateScan(frame.hits_S, frame.T_W_S);
    }
    (void)field.update();
    for (const bool allow_unknown : {false, true}) {
      addApproachRow(context, field, scans->benchmark.scene.distance, scene,
                     {.most = 0,
                      .spacing_m = 10 * request.voxel_size_m,
                      .stand_off_m = 10 * request.voxel_size_m,
                      .allow_unknown = allow_unknown},
                     100);
    }
  }
}

}  // namespace accessvdb::eval
