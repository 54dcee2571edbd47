// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Surface points that are put together when they are read, so that a large field can be written and drawn without a
/// copy of all of them.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "accessvdb/types.h"

namespace accessvdb {

/// A list of points at one moment, in the order of their ids. Reading is safe from several threads at once.
class SurfacePoints {
 public:
  SurfacePoints() = default;
  SurfacePoints(const SurfacePoints&) = delete;
  SurfacePoints& operator=(const SurfacePoints&) = delete;
  virtual ~SurfacePoints() = default;

  [[nodiscard]] virtual std::size_t size() const = 0;
  /// @param index  below size()
  [[nodiscard]] virtual SurfacePoint at(std::size_t index) const = 0;
  /// The same as at(index).position_W, in less time.
  [[nodiscard]] virtual Eigen::Vector3d position_W(std::size_t index) const = 0;
  [[nodiscard]] virtual Eigen::Vector3d origin_W() const = 0;  ///< world position of the map's local origin
  [[nodiscard]] virtual double voxel_size_m() const = 0;
  /// What the returns carried (FieldParams::carry).
  [[nodiscard]] virtual std::vector<std::string> attributeNames() const { return {}; }
  /// @param column  of attributeNames()  @return kNoAttribute where a point has none
  [[nodiscard]] virtual std::int32_t attribute(std::size_t /*index*/, std::size_t /*column*/) const {
    return kNoAttribute;
  }
  /// Whether points have SurfacePoint::margin_m.
  [[nodiscard]] virtual bool hasMargins() const { return false; }
  /// Whether they have SurfacePoint::access_probability.
  [[nodiscard]] virtual bool hasProbability() const { return false; }
  /// What the first return of a point had, where scans say it and points.las is to.
  struct FirstReturn {
    double gps_time = 0;
    std::uint8_t point_class = 0;
  };
  [[nodiscard]] virtual std::optional<FirstReturn> firstReturn(std::size_t /*index*/) const { return std::nullopt; }
};

/// The points of a snapshot, which must live as long.
class SnapshotPoints final : public SurfacePoints {
 public:
  explicit SnapshotPoints(const FieldSnapshot& snapshot) : snapshot_(snapshot) {}
  [[nodiscard]] std::size_t size() const override { return snapshot_.points.size(); }
  [[nodiscard]] SurfacePoint at(std::size_t index) const override { return snapshot_.points[index]; }
  [[nodiscard]] Eigen::Vector3d position_W(std::size_t index) const override {
    return snapshot_.points[index].position_W;
  }
  [[nodiscard]] Eigen::Vector3d origin_W() const override { return snapshot_.origin_W; }
  [[nodiscard]] double voxel_size_m() const override { return snapshot_.voxel_size_m; }
  [[nodiscard]] std::vector<std::string> attributeNames() const override {
    std::vector<std::string> names;
    for (const AttributeColumn& column : snapshot_.attributes) names.push_back(column.name);
    return names;
  }
  [[nodiscard]] std::int32_t attribute(std::size_t index, std::size_t column) const override {
    return snapshot_.attributes[column].values[index];
  }

 private:
  const FieldSnapshot& snapshot_;
};

}  // namespace accessvdb
