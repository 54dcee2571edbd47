// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "bags/messages.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "bags/message_reader.h"

namespace accessvdb::bags {
namespace {

constexpr const char* kAgain = "Copy the file again, or record it again";

std::string_view frameFrom(std::string_view text) {
  if (!text.empty() && text.front() == '/') text.remove_prefix(1);
  if (text.size() > 256) throw MessageError("recording.message", "has a frame with a name of over 256 bytes", kAgain);
  return text;
}

Header readHeader(MessageReader& reader) {
  if (reader.wire() == Wire::Ros1) (void)reader.number<std::uint32_t>();  // sequence
  Header header;
  // ROS 1 counts seconds without a sign; no recording is from before 1970 or after 2038.
  const std::int64_t seconds = reader.number<std::int32_t>();
  const std::int64_t nanoseconds = reader.number<std::uint32_t>();
  header.stamp_ns = seconds * 1'000'000'000 + nanoseconds;
  header.frame = frameFrom(reader.text());
  return header;
}

Eigen::Vector3d readVector(MessageReader& reader) {
  const auto x = reader.number<double>(), y = reader.number<double>(), z = reader.number<double>();
  return {x, y, z};
}

Eigen::Vector4d readQuaternion(MessageReader& reader) {
  const auto x = reader.number<double>(), y = reader.number<double>(), z = reader.number<double>(),
             w = reader.number<double>();
  return {w, x, y, z};
}

struct Field {
  bool found = false, usable = false, doubles = false;
  std::uint64_t offset = 0;
};

constexpr std::uint8_t kUint8 = 2, kInt32 = 5, kUint32 = 6, kFloat32 = 7, kFloat64 = 8;

std::optional<TimeField::Type> timeType(std::uint8_t type) {
  switch (type) {
    case kInt32:
      return TimeField::Type::Int32;
    case kUint32:
      return TimeField::Type::Uint32;
    case kFloat32:
      return TimeField::Type::Float32;
    case kFloat64:
      return TimeField::Type::Float64;
    default:
      return std::nullopt;
  }
}

/// Position and time in a point, from the fields that the message names.
void readFields(MessageReader& reader, CloudMessage& cloud) {
  std::array<Field, 3> xyz;
  std::size_t best = kPointTimeNames.size();
  const std::uint32_t count = reader.count(8);
  for (std::uint32_t i = 0; i < count; ++i) {
    const std::string_view name = reader.text();
    const std::uint64_t offset = reader.number<std::uint32_t>();
    const auto type = reader.number<std::uint8_t>();
    const auto values = reader.number<std::uint32_t>();
    cloud.fields.push_back({name, offset, type, values});
    const auto rank = static_cast<std::size_t>(std::find(kPointTimeNames.begin(), kPointTimeNames.end(), name) -
                                               kPointTimeNames.begin());
    if (const auto time_type = timeType(type); rank < best && time_type && values <= 1) {
      best = rank;
      cloud.time = TimeField{offset, *time_type, name};
    }
    const std::size_t small = std::string_view("xyz").find(name), capital = std::string_view("XYZ").find(name);
    if (name.size() != 1 || (small > 2 && (capital > 2 || xyz[capital].found))) continue;
    xyz[std::min(small, capital)] = {true, type == kFloat32 || type == kFloat64, type == kFloat64, offset};
  }
  for (const Field& field : xyz) {
    if (!field.found)
      throw MessageError("recording.fields", "has no fields x, y and z",
                         "Name another topic with ScanInputOptions::topic");
    if (!field.usable || field.doubles != xyz[0].doubles)
      throw MessageError("recording.fields", "has x, y and z that are not all float32 or all float64",
                         "Name another topic with ScanInputOptions::topic");
  }
  cloud.doubles = xyz[0].doubles;
  cloud.x = xyz[0].offset, cloud.y = xyz[1].offset, cloud.z = xyz[2].offset;
}

/// All sums in 64 bits; the factors have 32. Drivers that leave row_step empty, or fill in the size of all rows, have
/// rows one behind the other: so they are read, where the data have room for just that.
void checkSizes(CloudMessage& cloud) {
  if (cloud.points() == 0) return;
  const std::uint64_t scalar = cloud.doubles ? 8 : 4;
  // Points of less than x, y and z would take more memory than the message.
  if (std::max({cloud.x, cloud.y, cloud.z}) + scalar > cloud.point_bytes || cloud.point_bytes < 3 * scalar)
    throw MessageError("recording.fields", "has fields beyond the end of its points", kAgain);
  const std::uint64_t row = cloud.columns * cloud.point_bytes;
  const std::uint64_t have = cloud.data.size();
  const bool dense = have / cloud.rows == row && have % cloud.rows == 0;
  if (dense && (cloud.row_bytes == 0 || cloud.row_bytes == have)) cloud.row_bytes = row;
  if (row > have || (cloud.rows > 1 && (cloud.row_bytes < row || cloud.row_bytes > (have - row) / (cloud.rows - 1))))
    throw MessageError("recording.message",
                       "has " + std::to_string(have) + " bytes of data for " + std::to_string(cloud.columns) + " x " +
                           std::to_string(cloud.rows) + " points of " + std::to_string(cloud.point_bytes),
                       kAgain);
}

/// A time that is not inside of the points is none: nothing else depends on it.
void checkTime(CloudMessage& cloud) {
  if (!cloud.time) return;
  const std::uint64_t bytes = cloud.time->type == TimeField::Type::Float64 ? 8 : 4;
  if (cloud.time->offset + bytes > cloud.point_bytes) cloud.time.reset();
}

CloudMessage readPointCloud2(MessageReader& reader) {
  CloudMessage cloud;
  cloud.header = readHeader(reader);
  cloud.rows = reader.number<std::uint32_t>();
  cloud.columns = reader.number<std::uint32_t>();
  readFields(reader, cloud);
  if (reader.number<std::uint8_t>() != 0)
    throw MessageError("recording.big_endian", "has big-endian points", "Convert them to little-endian");
  cloud.point_bytes = reader.number<std::uint32_t>();
  cloud.row_bytes = reader.number<std::uint32_t>();
  cloud.data = reader.take(reader.count(1));
  checkSizes(cloud);
  checkTime(cloud);
  return cloud;
}

/// Points of offset_time, x, y, z, reflectivity, tag, line: 19 bytes, which CDR aligns to 4.
CloudMessage readLivox(MessageReader& reader) {
  constexpr std::size_t kPoint = 19;
  CloudMessage cloud;
  cloud.header = readHeader(reader);
  (void)reader.number<std::uint64_t>();  // timebase
  const auto announced = reader.number<std::uint32_t>();
  (void)reader.take(4);  // lidar_id, rsvd
  cloud.columns = reader.count(kPoint);
  if (announced != cloud.columns)
    throw MessageError("recording.message",
                       "announces " + std::to_string(announced) + " points and has " + std::to_string(cloud.columns),
                       kAgain);
  cloud.x = 4, cloud.y = 8, cloud.z = 12;
  cloud.time = TimeField{0, TimeField::Type::Uint32, kPointTimeNames.front()};
  cloud.fields = {{"reflectivity", 16, kUint8, 1}, {"tag", 17, kUint8, 1}, {"line", 18, kUint8, 1}};
  cloud.point_bytes = reader.wire() == Wire::Cdr ? 20 : kPoint;
  if (cloud.columns == 0) return cloud;
  // The last point is not filled up.
  const std::uint64_t bytes = (cloud.columns - 1) * cloud.point_bytes + kPoint;
  if (bytes > reader.left()) MessageReader::fail();
  cloud.data = reader.take(static_cast<std::size_t>(bytes));
  cloud.row_bytes = bytes;
  return cloud;
}

/// Values beyond float become infinite, as those of files do, so that they are counted as such.
template <typename To, typename From>
To convert(From value) {
  if constexpr (sizeof(To) < sizeof(From)) {
    if (std::abs(value) > std::numeric_limits<To>::max())
      return std::copysign(std::numeric_limits<To>::infinity(), static_cast<To>(value > 0 ? 1 : -1));
  }
  return static_cast<To>(value);
}

template <typename From, typename To>
void append(const CloudMessage& cloud, std::vector<Eigen::Matrix<To, 3, 1>>& points) {
  const std::size_t begin = points.size();
  points.resize(begin + static_cast<std::size_t>(cloud.points()));
  Eigen::Matrix<To, 3, 1>* to = points.data() + begin;
  for (std::uint64_t row = 0; row < cloud.rows; ++row) {
    const char* point = cloud.data.data() + row * cloud.row_bytes;
    for (std::uint64_t column = 0; column < cloud.columns; ++column, point += cloud.point_bytes, ++to) {
      From p[3];
      std::memcpy(p, point + cloud.x, sizeof(From));
      std::memcpy(p + 1, point + cloud.y, sizeof(From));
      std::memcpy(p + 2, point + cloud.z, sizeof(From));
      *to = {convert<To>(p[0]), convert<To>(p[1]), convert<To>(p[2])};
    }
  }
}

template <typename To>
void appendAny(const CloudMessage& cloud, std::vector<Eigen::Matrix<To, 3, 1>>& points) {
  if (cloud.points() == 0) return;
  if (cloud.doubles) {
    append<double>(cloud, points);
  } else {
    append<float>(cloud, points);
  }
}

template <typename From>
void appendTimesOf(const CloudMessage& cloud, std::vector<double>& times) {
  for (std::uint64_t row = 0; row < cloud.rows; ++row) {
    const char* point = cloud.data.data() + row * cloud.row_bytes + cloud.time->offset;
    for (std::uint64_t column = 0; column < cloud.columns; ++column, point += cloud.point_bytes) {
      From value;
      std::memcpy(&value, point, sizeof value);
      times.push_back(static_cast<double>(value));
    }
  }
}

}  // namespace

std::optional<MessageKind> kindOf(std::string_view type) {
  if (type == "sensor_msgs/PointCloud2") return MessageKind::PointCloud2;
  if (type == "livox_ros_driver2/CustomMsg" || type == "livox_ros_driver/CustomMsg" ||
      type == "livox_interfaces/CustomMsg")
    return MessageKind::LivoxCustom;
  if (type == "nav_msgs/Odometry") return MessageKind::Odometry;
  if (type == "geometry_msgs/PoseStamped") return MessageKind::PoseStamped;
  if (type == "geometry_msgs/PoseWithCovarianceStamped") return MessageKind::PoseWithCovarianceStamped;
  if (type == "sensor_msgs/Imu") return MessageKind::Imu;
  if (type == "tf2_msgs/TFMessage" || type == "tf/tfMessage") return MessageKind::Transforms;
  return std::nullopt;
}

std::optional<Wire> wireOf(std::string_view encoding) {
  if (encoding == "cdr") return Wire::Cdr;
  if (encoding == "ros1") return Wire::Ros1;
  return std::nullopt;
}

CloudMessage readCloud(MessageKind kind, std::string_view bytes, Wire wire) {
  MessageReader reader(bytes, wire);
  return kind == MessageKind::PointCloud2 ? readPointCloud2(reader) : readLivox(reader);
}

PoseMessage readPose(MessageKind kind, std::string_view bytes, Wire wire) {
  MessageReader reader(bytes, wire);
  PoseMessage pose;
  pose.header = readHeader(reader);
  if (kind == MessageKind::Odometry) pose.child = frameFrom(reader.text());
  pose.p = readVector(reader);
  pose.q = readQuaternion(reader);
  return pose;
}

ImuMessage readImu(std::string_view bytes, Wire wire) {
  MessageReader reader(bytes, wire);
  ImuMessage imu;
  imu.header = readHeader(reader);
  const auto skipCovariance = [&] {
    for (int i = 0; i < 9; ++i) (void)reader.number<double>();
  };
  (void)readQuaternion(reader);
  skipCovariance();
  imu.turn_rad_s = readVector(reader);
  skipCovariance();
  imu.force = readVector(reader);
  return imu;
}

std::vector<PoseMessage> readTransforms(std::string_view bytes, Wire wire) {
  constexpr std::size_t kLeastTransform = 64;
  MessageReader reader(bytes, wire);
  std::vector<PoseMessage> poses(reader.count(kLeastTransform));
  for (PoseMessage& pose : poses) {
    pose.header = readHeader(reader);
    pose.child = frameFrom(reader.text());
    pose.p = readVector(reader);
    pose.q = readQuaternion(reader);
  }
  return poses;
}

void appendPoints(const CloudMessage& cloud, std::vector<Eigen::Vector3f>& points) { appendAny(cloud, points); }
void appendPoints(const CloudMessage& cloud, std::vector<Eigen::Vector3d>& points) { appendAny(cloud, points); }

void appendTimes(const CloudMessage& cloud, std::vector<double>& times) {
  if (cloud.points() == 0) return;
  times.reserve(times.size() + static_cast<std::size_t>(cloud.points()));
  switch (cloud.time->type) {
    case TimeField::Type::Int32:
      return appendTimesOf<std::int32_t>(cloud, times);
    case TimeField::Type::Uint32:
      return appendTimesOf<std::uint32_t>(cloud, times);
    case TimeField::Type::Float32:
      return appendTimesOf<float>(cloud, times);
    case TimeField::Type::Float64:
      return appendTimesOf<double>(cloud, times);
  }
}

}  // namespace accessvdb::bags
