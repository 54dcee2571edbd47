// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The messages of ROS 1 and ROS 2 that are read: clouds and poses. Nothing is copied; texts and data point into the
/// message's bytes.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace accessvdb::bags {

enum class MessageKind { PointCloud2, LivoxCustom, Odometry, PoseStamped, PoseWithCovarianceStamped, Transforms, Imu };

/// @param type  as Topic::type @return nothing for types that are not read
[[nodiscard]] std::optional<MessageKind> kindOf(std::string_view type);
[[nodiscard]] constexpr bool isCloud(MessageKind kind) {
  return kind == MessageKind::PointCloud2 || kind == MessageKind::LivoxCustom;
}

/// Whether it poses one frame in another.
[[nodiscard]] constexpr bool isPose(MessageKind kind) {
  return kind == MessageKind::Odometry || kind == MessageKind::PoseStamped ||
         kind == MessageKind::PoseWithCovarianceStamped;
}

/// Thrown for a message that is not what its type says, or is not read: the caller knows the topic and the file.
class MessageError : public std::runtime_error {
 public:
  MessageError(std::string id, const std::string& problem, std::string advice)
      : std::runtime_error(problem), id_(std::move(id)), advice_(std::move(advice)) {}
  [[nodiscard]] const std::string& id() const { return id_; }
  [[nodiscard]] const std::string& advice() const { return advice_; }

 private:
  std::string id_, advice_;
};

/// How the bytes of a message are laid out.
enum class Wire { Cdr, Ros1 };
/// @param encoding  as Topic::encoding
[[nodiscard]] std::optional<Wire> wireOf(std::string_view encoding);

struct Header {
  std::int64_t stamp_ns = 0;  ///< since 1970; 0 where the sender left it empty
  std::string_view frame;     ///< without a leading slash
};

struct PoseMessage {
  Header header;
  std::string_view child;  ///< the frame that is posed; empty for PoseStamped
  Eigen::Vector3d p = Eigen::Vector3d::Zero();
  Eigen::Vector4d q = {1, 0, 0, 0};  ///< w x y z, as sent
};

struct ImuMessage {
  Header header;
  Eigen::Vector3d turn_rad_s = Eigen::Vector3d::Zero();
  Eigen::Vector3d force = Eigen::Vector3d::Zero();  ///< specific force; m/s^2, or g from some drivers
};

/// Names under which drivers send the time of each point, the most specific first.
inline constexpr std::array<std::string_view, 5> kPointTimeNames = {"offset_time", "timestamp", "timestamps", "time",
                                                                    "t"};

/// The time of each point, in the message's own unit.
struct TimeField {
  enum class Type { Int32, Uint32, Float32, Float64 };
  std::uint64_t offset = 0;  ///< in a point
  Type type = Type::Uint32;
  std::string_view name;
};

/// A number in each point, of the types of sensor_msgs/PointField. Not checked.
struct CloudField {
  std::string_view name;
  std::uint64_t offset = 0;
  std::uint8_t type = 0;
  std::uint32_t count = 0;
};

/// A cloud whose points are all inside of its data: checked.
struct CloudMessage {
  Header header;
  std::uint64_t rows = 1, columns = 0;
  std::uint64_t row_bytes = 0, point_bytes = 0;
  std::uint64_t x = 0, y = 0, z = 0;  ///< offsets in a point
  bool doubles = false;               ///< float64, else float32
  std::optional<TimeField> time;      ///< inside of the points: checked
  std::vector<CloudField> fields;     ///< all of them
  std::string_view data;

  [[nodiscard]] std::uint64_t points() const { return rows * columns; }
};

/// @throws MessageError "recording.message", "recording.big_endian", "recording.fields", "recording.compression"
[[nodiscard]] CloudMessage readCloud(MessageKind kind, std::string_view bytes, Wire wire);
[[nodiscard]] PoseMessage readPose(MessageKind kind, std::string_view bytes, Wire wire);
[[nodiscard]] ImuMessage readImu(std::string_view bytes, Wire wire);
[[nodiscard]] std::vector<PoseMessage> readTransforms(std::string_view bytes, Wire wire);

/// Appends all points, in the frame of the message. Values are passed on unchanged, NaN too.
void appendPoints(const CloudMessage& cloud, std::vector<Eigen::Vector3f>& points);
void appendPoints(const CloudMessage& cloud, std::vector<Eigen::Vector3d>& points);
/// The time of each point; of a cloud that has them.
void appendTimes(const CloudMessage& cloud, std::vector<double>& times);

}  // namespace accessvdb::bags
