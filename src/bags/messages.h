// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The messages of ROS 1 and ROS 2 that are read: clouds and poses. Nothing is copied; texts and data point into the
/// message's bytes.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace accessvdb::bags {

enum class MessageKind { PointCloud2, LivoxCustom, Odometry, PoseStamped, PoseWithCovarianceStamped, Transforms };

/// @param type  as Topic::type @return nothing for types that are not read
[[nodiscard]] std::optional<MessageKind> kindOf(std::string_view type);
[[nodiscard]] constexpr bool isCloud(MessageKind kind) {
  return kind == MessageKind::PointCloud2 || kind == MessageKind::LivoxCustom;
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

/// A cloud whose points are all inside of its data: checked.
struct CloudMessage {
  Header header;
  std::uint64_t rows = 1, columns = 0;
  std::uint64_t row_bytes = 0, point_bytes = 0;
  std::uint64_t x = 0, y = 0, z = 0;  ///< offsets in a point
  bool doubles = false;               ///< float64, else float32
  std::string_view data;

  [[nodiscard]] std::uint64_t points() const { return rows * columns; }
};

/// @throws MessageError "recording.message", "recording.big_endian", "recording.fields", "recording.compression"
[[nodiscard]] CloudMessage readCloud(MessageKind kind, std::string_view bytes, Wire wire);
[[nodiscard]] PoseMessage readPose(MessageKind kind, std::string_view bytes, Wire wire);
[[nodiscard]] std::vector<PoseMessage> readTransforms(std::string_view bytes, Wire wire);

/// Appends all points, in the frame of the message. Values are passed on unchanged, NaN too.
void appendPoints(const CloudMessage& cloud, std::vector<Eigen::Vector3f>& points);
void appendPoints(const CloudMessage& cloud, std::vector<Eigen::Vector3d>& points);

}  // namespace accessvdb::bags
