// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "dds/outgoing_messages.h"

#include <cstddef>
#include <cstring>

#include "dds/cdr_writer.h"
#include "io/results/label_colours.h"

namespace accessvdb::dds {
namespace {

/// Types of sensor_msgs/PointField.
constexpr std::uint8_t kUint8 = 2, kUint16 = 4, kUint32 = 6, kFloat32 = 7;

struct Field {
  const char* name;
  std::uint32_t offset;
  std::uint8_t type;
};
/// rgb is a float whose bits are 0x00RRGGBB, as PCL and RViz have it.
constexpr Field kFields[] = {{"x", 0, kFloat32},
                             {"y", 4, kFloat32},
                             {"z", 8, kFloat32},
                             {"rgb", 12, kFloat32},
                             {"id", 16, kUint32},
                             {"label", 20, kUint8},
                             {"reason", 21, kUint8},
                             {"score", 22, kUint16},
                             {"confidence", 24, kFloat32},
                             {"dx", 28, kFloat32},
                             {"dy", 32, kFloat32},
                             {"dz", 36, kFloat32},
                             {"access_probability", 40, kFloat32},
                             {"tools", 44, kUint32}};

template <typename T>
void put(char* point, std::size_t offset, T value) {
  std::memcpy(point + offset, &value, sizeof(T));
}

void putPoint(char* to, SurfacePoint point, const OutgoingFrame& frame) {
  const internal::Rgb rgb = internal::colourOf(point.label);
  if (frame.R_L_W) {
    point.position_W = frame.R_L_W->transpose() * point.position_W;
    point.direction_W = frame.R_L_W->cast<float>().transpose() * point.direction_W;
  }
  for (int axis = 0; axis < 3; ++axis) {
    put(to, static_cast<std::size_t>(4 * axis), static_cast<float>(point.position_W[axis]));
    put(to, static_cast<std::size_t>(28 + 4 * axis), point.direction_W[axis]);
  }
  if (frame.several_tools) put(to, 44, point.tools);
  put(to, 12, (std::uint32_t{rgb[0]} << 16) | (std::uint32_t{rgb[1]} << 8) | rgb[2]);
  put(to, 16, point.id);
  put(to, 20, static_cast<std::uint8_t>(point.label));
  put(to, 21, static_cast<std::uint8_t>(point.reason));
  put(to, 22, point.score);
  put(to, 24, point.confidence);
  put(to, 40, point.access_probability);
}

void putHeader(CdrWriter& message, std::int64_t stamp_ns, const OutgoingFrame& frame) {
  constexpr std::int64_t kNanoseconds = 1'000'000'000;
  message.number(static_cast<std::int32_t>(stamp_ns / kNanoseconds));
  message.number(static_cast<std::uint32_t>(stamp_ns % kNanoseconds));
  message.text(frame.name);
}

template <typename PointAt>
std::string cloud(std::size_t count, const PointAt& pointAt, std::int64_t stamp_ns, const OutgoingFrame& frame) {
  const std::size_t point_bytes = kPointBytes + (frame.several_tools ? kToolBytes : 0);
  const std::span<const Field> fields(kFields, std::size(kFields) - (frame.several_tools ? 0 : 1));
  CdrWriter message;
  putHeader(message, stamp_ns, frame);
  message.number(std::uint32_t{1});  // height
  message.number(static_cast<std::uint32_t>(count));
  message.number(static_cast<std::uint32_t>(fields.size()));
  for (const Field& field : fields) {
    message.text(field.name);
    message.number(field.offset);
    message.number(field.type);
    message.number(std::uint32_t{1});  // how many
  }
  message.number(std::uint8_t{0});  // not big-endian
  message.number(static_cast<std::uint32_t>(point_bytes));
  message.number(static_cast<std::uint32_t>(point_bytes * count));  // row
  const std::size_t begin = message.room(point_bytes * count);
  for (std::size_t n = 0; n < count; ++n) putPoint(message.bytes().data() + begin + point_bytes * n, pointAt(n), frame);
  message.number(std::uint8_t{1});  // dense: no point is without a place
  return message.take();
}

}  // namespace

std::string cloudMessage(const SurfacePoints& points, std::int64_t stamp_ns, const OutgoingFrame& frame) {
  return cloud(
      points.size(), [&](std::size_t n) { return points.at(n); }, stamp_ns, frame);
}

std::string cloudMessage(std::span<const SurfacePoint> points, std::int64_t stamp_ns, const OutgoingFrame& frame) {
  return cloud(
      points.size(), [&](std::size_t n) -> const SurfacePoint& { return points[n]; }, stamp_ns, frame);
}

std::string posesMessage(std::span<const Eigen::Isometry3d> T_WT, std::int64_t stamp_ns, const OutgoingFrame& frame) {
  CdrWriter message;
  putHeader(message, stamp_ns, frame);
  message.number(static_cast<std::uint32_t>(T_WT.size()));
  for (const Eigen::Isometry3d& pose_W : T_WT) {
    Eigen::Isometry3d pose = pose_W;
    if (frame.R_L_W) pose.prerotate(frame.R_L_W->transpose());
    const Eigen::Quaterniond q(pose.linear());
    for (const double number :
         {pose.translation().x(), pose.translation().y(), pose.translation().z(), q.x(), q.y(), q.z(), q.w()})
      message.number(number);
  }
  return message.take();
}

std::string textMessage(const std::string& text) {
  CdrWriter message;
  message.text(text);
  return message.take();
}

}  // namespace accessvdb::dds
