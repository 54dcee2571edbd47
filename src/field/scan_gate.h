// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The gate: returns come in, in any frame and any state; only good ones go on, in the local frame. Dropped ones are
/// counted by reason. Behind this gate, no coordinate is NaN, infinite or out of bounds.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "accessvdb/params.h"
#include "accessvdb/types.h"
#include "field/tools/window_margins.h"

namespace accessvdb::internal {

/// Good returns of one scan in the local frame.
struct GatedScan {
  std::vector<Eigen::Vector3f> p_L;
  std::vector<Eigen::Vector3f> q_L;                     ///< [n], or [1] for all
  std::vector<std::int32_t> attributes;                 ///< [n x FieldParams::carry], row by row
  Eigen::Matrix3d R_W_S = Eigen::Matrix3d::Identity();  ///< the sensor's, if the scan has one pose
};

class ScanGate {
 public:
  /// @param origin_W  see FieldParams::origin_W  @param window  returns elsewhere are skipped: neither used nor dropped
  /// @param attributes  how many values each return carries
  explicit ScanGate(const TsdfParams& resolved, const std::optional<std::array<double, 3>>& origin_W = std::nullopt,
                    const std::optional<VoxelColumnBox>& window = std::nullopt, std::size_t attributes = 0);

  using Attributes = std::span<const std::int32_t>;
  /// @param attributes  row by row, as many values for each return as FieldParams::carry names; empty: of none
  /// @return the good returns, valid until the next call
  /// @throws UnusableInput for a pose that is not finite and rigid
  /// @throws InvalidArgument "carry.sizes"
  const GatedScan& gate(std::span<const Eigen::Vector3f> points_S, const Eigen::Isometry3d& T_W_S, FrameStats& stats,
                        Attributes attributes = {});
  const GatedScan& gate(std::span<const Eigen::Vector3d> points_W, std::span<const Eigen::Vector3d> origins_W,
                        FrameStats& stats, Attributes attributes = {});
  /// Returns that passed a gate with the same origin before. @param q_L  [n] or [1]
  const GatedScan& gateLocal(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
                             FrameStats& stats, Attributes attributes = {});

  /// World position of the local origin: the first sensor position rounded to whole voxels.
  [[nodiscard]] const Eigen::Vector3d& origin_W() const { return origin_W_; }
  [[nodiscard]] bool hasOrigin() const { return have_origin_; }
  /// As it was saved, to the last bit.
  void restoreOrigin(const Eigen::Vector3d& origin_W) {
    origin_W_ = origin_W;
    have_origin_ = true;
  }
  [[nodiscard]] std::uint64_t bytes() const {
    return checked_.capacity() * sizeof(Checked) +
           (scan_.p_L.capacity() + scan_.q_L.capacity()) * sizeof(scan_.p_L[0]) +
           scan_.attributes.capacity() * sizeof(scan_.attributes[0]);
  }

 private:
  /// A return in the local frame, or the reason why it was dropped.
  struct Checked {
    Eigen::Vector3f p_L, q_L;
    std::optional<DropReason> dropped;
    bool outside = false;  ///< of the window
  };
  void setOrigin(const Eigen::Vector3d& sensor_W);
  [[nodiscard]] Checked check(const Eigen::Vector3d& p_L, const Eigen::Vector3d& q_L) const;
  [[nodiscard]] Checked checkLocal(const Eigen::Vector3f& p_L, const Eigen::Vector3f& q_L) const;
  void startScan(const Eigen::Matrix3d& R_W_S);
  void requireAttributes(std::size_t returns, Attributes attributes) const;
  template <typename CheckOf>
  void admit(std::size_t count, bool own_origins, const CheckOf& checkOf, FrameStats& stats, Attributes attributes);

  TsdfParams params_;
  float inverse_voxel_size_;
  std::optional<VoxelColumnBox> window_;
  std::size_t attributes_;  ///< values per return
  // One scan's returns. The memory is reused, because the system has to clear newly allocated memory first.
  GatedScan scan_;
  std::vector<Checked> checked_;
  bool have_origin_ = false;
  Eigen::Vector3d origin_W_ = {0, 0, 0};
};

}  // namespace accessvdb::internal
