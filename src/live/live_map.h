// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The map of a live session: one field, or a rolling one.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <variant>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/live_session.h"
#include "accessvdb/rolling_field.h"
#include "accessvdb/scan_io.h"
#include "accessvdb/tool_spec.h"
#include "live/live_poses.h"

namespace accessvdb::internal {

class LiveMap {
 public:
  /// @throws what LiveSession's constructor throws
  LiveMap(std::vector<ToolSpec> tools, const FieldParams& params, const LiveOptions& options,
          const TableProgress& progress);

  FrameStats integrate(const io::ScanRecord& record, double stamp_s);
  UpdateStats update();
  /// AccessibilityField::setBudgetPoints(). @throws InvalidArgument "live.rolling" of a rolling map
  void setBudgetPoints(int points) { field().setBudgetPoints(points); }
  /// As LiveStep::changed. After an update().
  [[nodiscard]] std::vector<SurfacePoint> takeChanged();
  /// Between scans, so that what a device that leads told wrong is told again. @param at_end  waits for the host's map
  /// @return whether there may be something to tell
  [[nodiscard]] bool follow(bool at_end);
  void leaveOut(std::span<const Eigen::Vector3d> centres_W, double radius_m);
  /// @throws InvalidArgument "live.rolling"
  void reset();
  /// Sets what it knows of LiveStatus. From the memory limit on it no longer grows, or tiles leave.
  void tell(LiveStatus& status);

  [[nodiscard]] const FieldParams& params() const;
  [[nodiscard]] const std::vector<ToolSpec>& tools() const;
  [[nodiscard]] Eigen::Vector3d origin_W() const;
  /// @throws InvalidArgument "live.rolling" of a rolling map
  [[nodiscard]] AccessibilityField& field();
  /// How the poses of a rolling map are turned: kept with its checkpoints.
  void noteLevelling(const std::optional<Eigen::Matrix3d>& R_L_W) {
    if (RollingField* const tiles = rolling()) tiles->setLevelling(R_L_W);
  }
  /// Of a map that goes on, and has scans. @param poses  get the level that was measured then
  /// @throws UnusableInput "rolling.changed" if it was turned otherwise
  void goOnLevel(const std::filesystem::path& folder, LivePoses& poses) const;
  [[nodiscard]] RollingField* rolling() { return std::get_if<RollingField>(&map_); }
  [[nodiscard]] const RollingField* rolling() const { return std::get_if<RollingField>(&map_); }

 private:
  using Map = std::variant<AccessibilityField, RollingField>;
  static Map make(std::vector<ToolSpec> tools, const FieldParams& params, const LiveOptions& options,
                  const TableProgress& progress);
  template <typename AnyMap>
  [[nodiscard]] static auto& oneOf(AnyMap& map) {
    if (auto* const one = std::get_if<AccessibilityField>(&map)) return *one;
    refuseTiles();
  }
  [[noreturn]] static void refuseTiles();

  FieldParams given_params_;
  std::uint64_t limit_bytes_;
  Map map_;
};

}  // namespace accessvdb::internal
