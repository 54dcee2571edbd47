// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Layout of a record of points.ply, shared by writer and reader.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "accessvdb/field_io.h"
#include "accessvdb/types.h"

namespace accessvdb::internal {

struct PointProperty {
  const char* type;
  const char* name;
};

/// In this order, packed, little endian.
inline constexpr std::array<PointProperty, 18> kPointsPlyProperties = {{{"double", "x"},
                                                                        {"double", "y"},
                                                                        {"double", "z"},
                                                                        {"float", "nx"},
                                                                        {"float", "ny"},
                                                                        {"float", "nz"},
                                                                        {"uchar", "red"},
                                                                        {"uchar", "green"},
                                                                        {"uchar", "blue"},
                                                                        {"uchar", "label"},
                                                                        {"uchar", "reason"},
                                                                        {"ushort", "score"},
                                                                        {"float", "confidence"},
                                                                        {"float", "stability"},
                                                                        {"float", "dx"},
                                                                        {"float", "dy"},
                                                                        {"float", "dz"},
                                                                        {"float", "yaw"}}};
inline constexpr std::size_t kPointsPlyRecordBytes = 3 * 8 + 3 * 4 + 3 + 2 + 2 + 6 * 4;
/// Behind them, where the tool does not only turn in yaw: how it is held, world from tool, and the orientation's index.
inline constexpr std::array<PointProperty, 5> kPointsPlyOrientation = {
    {{"float", "qw"}, {"float", "qx"}, {"float", "qy"}, {"float", "qz"}, {"ushort", "orientation"}}};
/// And behind those, where it rolls: the roll's index.
inline constexpr PointProperty kPointsPlyRoll = {"uchar", "roll"};

/// Behind all those, of several tools: which one stands for the point, and a bit for each that reaches it.
inline constexpr std::array<PointProperty, 2> kPointsPlyTools = {{{"uchar", "tool"}, {"uint", "tools"}}};

/// Behind those, of tools with margins: the largest with which the tool reaches the point, and how far it can turn
/// there; -1: it does not reach it.
inline constexpr std::array<PointProperty, 2> kPointsPlyMargin = {{{"float", "margin_m"}, {"float", "free_arc_deg"}}};

/// Behind those, of the product's update policy: SurfacePoint::access_probability.
inline constexpr PointProperty kPointsPlyProbability = {"float", "access_probability"};
/// Files with it say which constants it is from: kProbabilityFit.
inline constexpr const char* kProbabilityFitKey = "access_probability";

/// Which of these a file has.
struct PointsPlyColumns {
  bool orientation = false;  ///< kPointsPlyOrientation
  bool roll = false;         ///< kPointsPlyRoll, only with orientation
  bool tools = false;        ///< kPointsPlyTools
  bool margin = false;       ///< kPointsPlyMargin, only with tools
  bool probability = false;  ///< kPointsPlyProbability
  std::size_t carried = 0;   ///< behind all of them, attributes of the returns as int

  [[nodiscard]] constexpr std::size_t recordBytes() const {
    return kPointsPlyRecordBytes + (orientation ? 4 * 4 + 2 : 0) + (roll ? 1 : 0) + (tools ? 1 + 4 : 0) +
           (margin ? 2 * 4 : 0) + (probability ? 4 : 0) + 4 * carried;
  }
  /// Where they are in a record.
  [[nodiscard]] constexpr std::size_t carriedBegin() const { return recordBytes() - 4 * carried; }
  friend bool operator==(const PointsPlyColumns&, const PointsPlyColumns&) = default;
};
/// Of a field with this metadata, without the attributes of its returns.
[[nodiscard]] PointsPlyColumns pointsPlyColumns(const io::FieldMetadata& metadata);
/// Read and written at a time.
inline constexpr std::size_t kPointsPlyRecordsPerBlock = 16384;
inline constexpr double kDegreesPerRadian = 57.295779513082320876798;

/// The columns of a record, unchecked: weight and the confident flag are not among them, nor is the direction's index
/// if it is not oriented.
[[nodiscard]] SurfacePoint pointOfRecord(const char* record, const PointsPlyColumns& columns);
/// An attribute that the returns carried, as the record has it. @param column  below columns.carried
[[nodiscard]] std::int32_t carriedOfRecord(const char* record, const PointsPlyColumns& columns, std::size_t column);
/// What the header says of it, before the name.
inline constexpr const char* kPointsPlyCarried = "property int ";

}  // namespace accessvdb::internal
