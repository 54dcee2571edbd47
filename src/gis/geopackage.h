// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Points with attributes as one layer of a GeoPackage, by GDAL.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <iosfwd>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "accessvdb/survey_frame.h"

namespace accessvdb::gis {

/// A column and its type by that of a first value; monostate is no value.
using Value = std::variant<std::monostate, std::int32_t, double, std::string>;
struct LayerColumn {
  std::string name;
  enum class Type : std::uint8_t { Whole, Real, Text } type = Type::Whole;
};

class GeoPackage {
 public:
  /// @param description  of the layer  @param frame  positions are in its unit
  /// @throws OutputError "gdal.failed"; UnusableInput "gdal.missing"
  GeoPackage(const std::string& layer, const std::string& description, const std::vector<LayerColumn>& columns,
             const SurveyFrame& frame);
  ~GeoPackage();
  GeoPackage(const GeoPackage&) = delete;
  GeoPackage& operator=(const GeoPackage&) = delete;

  /// @param values  [columns]
  void add(std::int64_t id, const Eigen::Vector3d& position, const std::vector<Value>& values);
  /// Ends it. It is in memory until then.
  void write(std::ostream& out);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace accessvdb::gis
