// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "live/live_map.h"

#include <limits>
#include <string>
#include <utility>

#include "accessvdb/error.h"
#include "accessvdb/surface_points.h"
#include "field/field_access.h"
#include "io/poses/levelling.h"

namespace accessvdb::internal {
namespace {

template <typename Field>
FrameStats integrateInto(Field& field, const io::ScanRecord& record, double stamp_s) {
  return record.origins_W.empty() ? field.integrateScan(record.points_S, record.T_W_S, stamp_s)
                                  : field.integrateRays(record.points_W, record.origins_W, stamp_s);
}

}  // namespace

LiveMap::LiveMap(std::vector<ToolSpec> tools, const FieldParams& params, const LiveOptions& options,
                 const TableProgress& progress)
    : given_params_(params),
      limit_bytes_(options.memory_limit_bytes),
      map_(make(std::move(tools), params, options, progress)) {}

LiveMap::Map LiveMap::make(std::vector<ToolSpec> tools, const FieldParams& params, const LiveOptions& options,
                           const TableProgress& progress) {
  if (!options.rolling) {
    return AccessibilityField(std::move(tools), params, progress);
  }
  RollingOptions rolling = *options.rolling;
  rolling.memory_limit_bytes = options.memory_limit_bytes;
  rolling.notes_changes = true;
  return options.resume ? RollingField::resume(std::move(tools), params, std::move(rolling), progress)
                        : RollingField(std::move(tools), params, std::move(rolling), progress);
}

void LiveMap::refuseTiles() {
  throw InvalidArgument("live.rolling", "rolling", "makes a map of tiles, for which this is not possible",
                        "Use a session without rolling, or its rolling field");
}

void LiveMap::goOnLevel(const std::filesystem::path& folder, LivePoses& poses) const {
  const RollingField* const tiles = rolling();
  if (tiles == nullptr || tiles->status().steps == 0) return;
  const LiveLevel& level = poses.level();
  const std::optional<Eigen::Matrix3d>& before = tiles->levelling();
  if (!level.isKnown() && before) return poses.setLevelling(*before);
  if (level.isKnown() && level.R_L_W() == before) return;
  const auto words = [](const std::optional<Eigen::Matrix3d>& R_L_W) {
    return R_L_W ? "level " + io::levelInWords(*R_L_W) : std::string("no level");
  };
  throw UnusableInput("rolling.changed", folder.string(),
                      "was made with " + words(before) + " instead of " +
                          (level.isKnown() ? words(level.R_L_W()) : std::string("that of the IMU")),
                      "Use what it was made with, or another folder");
}

AccessibilityField& LiveMap::field() { return oneOf(map_); }

FrameStats LiveMap::integrate(const io::ScanRecord& record, double stamp_s) {
  RollingField* const tiles = rolling();
  return tiles != nullptr ? integrateInto(*tiles, record, stamp_s) : integrateInto(field(), record, stamp_s);
}

UpdateStats LiveMap::update() {
  if (rolling() == nullptr) return field().update();
  try {
    return rolling()->update();
  } catch (const OutputError&) {  // afterwards: RollingStatus::unsaved
    return {};
  }
}

std::vector<SurfacePoint> LiveMap::takeChanged() {
  return rolling() != nullptr ? rolling()->takeChanged() : FieldAccess::takeChanged(field());
}

bool LiveMap::follow(bool at_end) { return rolling() == nullptr && FieldAccess::follow(field(), at_end); }

void LiveMap::leaveOut(std::span<const Eigen::Vector3d> centres_W, double radius_m) {
  if (rolling() != nullptr) {
    rolling()->leaveOut(centres_W, radius_m);
  } else {
    field().leaveOut(centres_W, radius_m);
  }
}

void LiveMap::reset() {
  AccessibilityField& before = field();
  const std::vector<ToolSpec> tools = before.tools();
  before = AccessibilityField(tools, given_params_);
}

void LiveMap::tell(LiveStatus& status) {
  if (const RollingField* const tiles = rolling()) {
    status.rolling = tiles->status();
    status.memory_bytes = status.rolling->memory_bytes + status.rolling->device_bytes;
    status.surface_points = status.rolling->points;
    return;
  }
  AccessibilityField& field = this->field();
  status.memory_bytes =
      FieldAccess::heldBytes(field, limit_bytes_ > 0 ? limit_bytes_ : std::numeric_limits<std::uint64_t>::max());
  if (field.grows() && limit_bytes_ > 0 && status.memory_bytes > limit_bytes_) field.stopGrowing();
  status.memory_full = !field.grows();
}

const FieldParams& LiveMap::params() const { return rolling() != nullptr ? rolling()->params() : oneOf(map_).params(); }

const std::vector<ToolSpec>& LiveMap::tools() const {
  return rolling() != nullptr ? rolling()->tools() : oneOf(map_).tools();
}

Eigen::Vector3d LiveMap::origin_W() const {
  return rolling() != nullptr ? rolling()->origin_W() : oneOf(map_).origin_W();
}

}  // namespace accessvdb::internal
