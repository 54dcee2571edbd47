// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "accessvdb/program/points_mcap.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <span>
#include <sstream>
#include <utility>

#include "accessvdb/field_io.h"
#include "bags/mcap_writer.h"
#include "io/results/foxglove_schemas.h"
#include "io/results/label_colours.h"
#include "io/results/points_ply.h"
#include "io/results/program_version.h"
#include "io/results/protobuf_message.h"

namespace accessvdb::io {
namespace {

/// Of PackedElementField.
enum class Packed : std::uint8_t { Uint8 = 1, Uint16 = 3, Int32 = 6, Float32 = 7 };
constexpr const char *kWorld = "world", *kMap = "map";
/// A result has no time: all is said at second 1, because some programs take 0 for none.
constexpr std::uint64_t kTime_ns = 1'000'000'000;
/// In voxels.
constexpr double kArrowLength = 6, kHeadLength = 2, kShaftDiameter = 0.5, kHeadDiameter = 1.2;

ProtobufMessage timeMessage() { return ProtobufMessage().whole(1, kTime_ns / 1'000'000'000); }
ProtobufMessage vectorMessage(const Eigen::Vector3d& v) {
  return ProtobufMessage().real(1, v.x()).real(2, v.y()).real(3, v.z());
}
ProtobufMessage rotationMessage(const Eigen::Quaterniond& q) {
  return ProtobufMessage().real(1, q.x()).real(2, q.y()).real(3, q.z()).real(4, q.w());
}

/// Records of points, as the message has them.
class PackedPoints {
 public:
  /// @param probability  points have access probabilities
  PackedPoints(const std::vector<std::string>& attributes, bool probability) : probability_(probability) {
    for (const char* axis : {"x", "y", "z"}) addField(axis, Packed::Float32, 4);
    addField("confidence", Packed::Float32, 4);
    if (probability_) addField("access_probability", Packed::Float32, 4);
    for (const std::string& name : attributes) addField(name, Packed::Int32, 4);
    addField("score", Packed::Uint16, 2);
    for (const char* name : {"label", "reason", "red", "green", "blue", "alpha"}) addField(name, Packed::Uint8, 1);
  }

  void add(const SurfacePoint& point, const Eigen::Vector3d& origin_W, std::span<const std::int32_t> carried) {
    const Eigen::Vector3f p_L = (point.position_W - origin_W).cast<float>();
    for (int axis = 0; axis < 3; ++axis) put(p_L[axis]);
    put(point.confidence);
    if (probability_) put(point.access_probability);
    for (const std::int32_t value : carried) put(value);
    put(point.score);
    put(static_cast<std::uint8_t>(point.label));
    put(static_cast<std::uint8_t>(point.reason));
    for (const std::uint8_t part : internal::colourOf(point.label)) put(part);
    put(std::uint8_t{255});
  }
  [[nodiscard]] ProtobufMessage message() const {
    const ProtobufMessage pose = ProtobufMessage()
                                     .message(1, vectorMessage({0, 0, 0}))
                                     .message(2, rotationMessage(Eigen::Quaterniond(1, 0, 0, 0)));
    ProtobufMessage cloud;
    cloud.message(1, timeMessage()).bytes(2, kMap).message(3, pose).fixed32(4, stride_);
    for (const ProtobufMessage& field : fields_) cloud.message(5, field);
    return cloud.bytes(6, data_);
  }

 private:
  void addField(const std::string& name, Packed type, std::uint32_t bytes) {
    fields_.push_back(ProtobufMessage().bytes(1, name).fixed32(2, stride_).whole(3, static_cast<std::uint64_t>(type)));
    stride_ += bytes;
  }
  template <typename T>
  void put(const T& value) {
    data_.append(reinterpret_cast<const char*>(&value), sizeof value);
  }

  bool probability_;
  std::uint32_t stride_ = 0;
  std::vector<ProtobufMessage> fields_;
  std::string data_;
};

/// From where the tool comes, with its tip at the point.
ProtobufMessage arrowMessage(const SurfacePoint& point, const Eigen::Vector3d& origin_W, double voxel_size_m) {
  const Eigen::Vector3d back = point.direction_W.cast<double>().normalized();
  const Eigen::Vector3d from_L = point.position_W - origin_W + kArrowLength * voxel_size_m * back;
  // An arrow lies along its own x.
  const Eigen::Quaterniond turn = Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitX(), -back);
  const auto colour = internal::colourOf(point.label);
  ProtobufMessage colour_message;
  for (int n = 0; n < 3; ++n) colour_message.real(n + 1, colour[static_cast<std::size_t>(n)] / 255.0);
  colour_message.real(4, 1);
  return ProtobufMessage()
      .message(1, ProtobufMessage().message(1, vectorMessage(from_L)).message(2, rotationMessage(turn)))
      .real(2, (kArrowLength - kHeadLength) * voxel_size_m)
      .real(3, kShaftDiameter * voxel_size_m)
      .real(4, kHeadLength * voxel_size_m)
      .real(5, kHeadDiameter * voxel_size_m)
      .message(6, colour_message);
}

/// One of so many that no more than `most` are left.
std::uint64_t oneOfSoMany(std::uint64_t count, std::uint64_t most) {
  return std::max<std::uint64_t>(1, (count + most - 1) / std::max<std::uint64_t>(1, most));
}

}  // namespace

PointsMcap pointsMcap(const std::vector<std::filesystem::path>& points, const McapOptions& options) {
  PointsMcap made;
  PointsHeader header;
  for (const std::filesystem::path& file : points) {
    header = visitPoints(file, [&](const SurfacePoint& point) {
      ++made.points;
      if (point.label == PointLabel::Accessible) ++made.accessible;
    });
  }
  const std::uint64_t every = oneOfSoMany(made.points, options.most_points);
  const std::uint64_t every_arrow = oneOfSoMany(made.accessible, options.most_arrows);
  PackedPoints cloud(header.attributes, internal::pointsPlyColumns(header.metadata).probability);
  ProtobufMessage entity;
  entity.message(1, timeMessage()).bytes(2, kMap).bytes(3, "approaches").whole(5, 1);
  std::uint64_t at = 0, accessible = 0;
  for (const std::filesystem::path& file : points) {
    visitCarryingPoints(file, [&](const SurfacePoint& point, std::span<const std::int32_t> carried) {
      if (at++ % every == 0) {
        cloud.add(point, header.origin_W, carried);
        ++made.shown;
      }
      if (point.label != PointLabel::Accessible || options.most_arrows == 0 || accessible++ % every_arrow != 0) return;
      entity.message(7, arrowMessage(point, header.origin_W, header.voxel_size_m));
      ++made.arrows;
    });
  }
  std::ostringstream out;
  bags::McapWriter writer(out, std::string("AccessVDB ") + internal::programVersion());
  const std::string descriptors = foxgloveDescriptors();
  const auto say = [&](const char* topic, const char* type) {
    return writer.addChannel(writer.addSchema(type, "protobuf", descriptors), topic, "protobuf");
  };
  const std::uint16_t frame = say("/accessvdb/frame", "foxglove.FrameTransform");
  const std::uint16_t labelled = say("/accessvdb/points", "foxglove.PointCloud");
  const std::uint16_t approaches = say("/accessvdb/approaches", "foxglove.SceneUpdate");
  writer.add(frame, kTime_ns,
             ProtobufMessage()
                 .message(1, timeMessage())
                 .bytes(2, kWorld)
                 .bytes(3, kMap)
                 .message(4, vectorMessage(header.origin_W))
                 .message(5, rotationMessage(Eigen::Quaterniond(1, 0, 0, 0)))
                 .encoded());
  writer.add(labelled, kTime_ns, cloud.message().encoded());
  writer.add(approaches, kTime_ns, ProtobufMessage().message(2, entity).encoded());
  writer.finish();
  made.content = std::move(out).str();
  return made;
}

}  // namespace accessvdb::io
