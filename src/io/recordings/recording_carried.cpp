// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the points of clouds in a recording carry.
#include <array>

#include "io/recordings/recording_steps.h"
#include "io/streams/input_file.h"

namespace accessvdb::io {

CarriedFields RecordingSteps::carriedOf(const bags::CloudMessage& cloud, std::size_t step) const {
  // In the order of their numbers in sensor_msgs/PointField, from 1 on.
  constexpr std::array kTypes = {ScalarType::Int8,  ScalarType::Uint8,  ScalarType::Int16,   ScalarType::Uint16,
                                 ScalarType::Int32, ScalarType::Uint32, ScalarType::Float32, ScalarType::Float64};
  std::vector<RecordField> fields;
  for (const bags::CloudField& field : cloud.fields) {
    if (field.type < 1 || field.type > kTypes.size() || field.count > 1) continue;
    const ScalarType type = kTypes[field.type - 1u];
    if (field.offset + scalarBytes(type) > cloud.point_bytes) continue;
    fields.push_back({.name = std::string(field.name), .offset = field.offset, .type = type});
  }
  return {fields, carry_, subject_ + " " + topic_, static_cast<std::int32_t>(step)};
}

std::vector<std::int32_t> RecordingSteps::attributesOf(const bags::CloudMessage& cloud, std::size_t step) const {
  std::vector<std::int32_t> attributes;
  if (carry_.empty() || cloud.points() == 0) return attributes;
  const CarriedFields carried = carriedOf(cloud, step);
  attributes.reserve(static_cast<std::size_t>(cloud.points()) * carry_.size());
  std::uint64_t number = 0;
  for (std::uint64_t row = 0; row < cloud.rows; ++row) {
    const char* point = cloud.data.data() + row * cloud.row_bytes;
    for (std::uint64_t column = 0; column < cloud.columns; ++column, point += cloud.point_bytes)
      carried.append(point, false, number++, attributes);
  }
  return attributes;
}

/// @throws UnusableInput "carry.missing" if no cloud has an attribute that is wanted
void RecordingSteps::requireCarried() {
  CarriedCheck check(carry_);
  for (std::size_t step = 0; step < steps_.size() && !check.hasAll(); ++step) {
    const IndexedCloud& indexed = steps_[step];
    const CarriedFields carried =
        carriedOf(bags::readCloud(cloud_kind_, recordings_[indexed.file]->read(indexed.place), wire_), step);
    check.note(&carried, subject_ + " " + topic_);
  }
  check.require();
}

}  // namespace accessvdb::io
