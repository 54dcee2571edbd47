// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Source: names and numbers of https://docs.foxglove.dev/docs/sdk/schemas; descriptor.proto of Protocol Buffers.
#include "io/results/foxglove_schemas.h"

#include <array>
#include <cctype>
#include <charconv>
#include <string_view>
#include <utility>

#include "io/results/protobuf_message.h"

namespace accessvdb::io {
namespace {

/// In the language of .proto files, as far as DescriptorWriter reads it.
constexpr std::string_view kMessages = R"(
message Vector3 { double x = 1; double y = 2; double z = 3; }
message Quaternion { double x = 1; double y = 2; double z = 3; double w = 4; }
message Pose { Vector3 position = 1; Quaternion orientation = 2; }
message Point3 { double x = 1; double y = 2; double z = 3; }
message Color { double r = 1; double g = 2; double b = 3; double a = 4; }
message KeyValuePair { string key = 1; string value = 2; }
message PackedElementField {
  enum NumericType { UNKNOWN = 0; UINT8 = 1; INT8 = 2; UINT16 = 3; INT16 = 4; UINT32 = 5; INT32 = 6; FLOAT32 = 7; FLOAT64 = 8; }
  string name = 1; fixed32 offset = 2; NumericType type = 3;
}
message PointCloud {
  Timestamp timestamp = 1; string frame_id = 2; Pose pose = 3; fixed32 point_stride = 4;
  repeated PackedElementField fields = 5; bytes data = 6;
}
message FrameTransform {
  Timestamp timestamp = 1; string parent_frame_id = 2; string child_frame_id = 3; Vector3 translation = 4;
  Quaternion rotation = 5;
}
message ArrowPrimitive {
  Pose pose = 1; double shaft_length = 2; double shaft_diameter = 3; double head_length = 4; double head_diameter = 5;
  Color color = 6;
}
message CubePrimitive { Pose pose = 1; Vector3 size = 2; Color color = 3; }
message SpherePrimitive { Pose pose = 1; Vector3 size = 2; Color color = 3; }
message CylinderPrimitive { Pose pose = 1; Vector3 size = 2; double bottom_scale = 3; double top_scale = 4; Color color = 5; }
message LinePrimitive {
  enum Type { LINE_STRIP = 0; LINE_LOOP = 1; LINE_LIST = 2; }
  Type type = 1; Pose pose = 2; double thickness = 3; bool scale_invariant = 4; repeated Point3 points = 5; Color color = 6;
  repeated Color colors = 7; repeated fixed32 indices = 8;
}
message TriangleListPrimitive {
  Pose pose = 1; repeated Point3 points = 2; Color color = 3; repeated Color colors = 4; repeated fixed32 indices = 5;
}
message TextPrimitive {
  Pose pose = 1; bool billboard = 2; double font_size = 3; bool scale_invariant = 4; Color color = 5; string text = 6;
}
message ModelPrimitive {
  Pose pose = 1; Vector3 scale = 2; Color color = 3; bool override_color = 4; string url = 5; string media_type = 6;
  bytes data = 7;
}
message SceneEntityDeletion {
  enum Type { MATCHING_ID = 0; ALL = 1; }
  Timestamp timestamp = 1; Type type = 2; string id = 3;
}
message SceneEntity {
  Timestamp timestamp = 1; string frame_id = 2; string id = 3; Duration lifetime = 4; bool frame_locked = 5;
  repeated KeyValuePair metadata = 6; repeated ArrowPrimitive arrows = 7; repeated CubePrimitive cubes = 8;
  repeated SpherePrimitive spheres = 9; repeated CylinderPrimitive cylinders = 10; repeated LinePrimitive lines = 11;
  repeated TriangleListPrimitive triangles = 12; repeated TextPrimitive texts = 13; repeated ModelPrimitive models = 14;
}
message SceneUpdate { repeated SceneEntityDeletion deletions = 1; repeated SceneEntity entities = 2; }
)";
constexpr std::string_view kTimestamp = "message Timestamp { int64 seconds = 1; int32 nanos = 2; }";
constexpr std::string_view kDuration = "message Duration { int64 seconds = 1; int32 nanos = 2; }";

/// From the text to a FileDescriptorProto. The text is ours: it is not checked.
class DescriptorWriter {
 public:
  DescriptorWriter(std::string_view text, std::string package) : text_(text), package_(std::move(package)) {}

  ProtobufMessage file(std::string_view name, std::initializer_list<std::string_view> dependencies) {
    ProtobufMessage file;
    file.bytes(1, name).bytes(2, package_);
    for (const std::string_view dependency : dependencies) file.bytes(3, dependency);
    while (word() == "message") file.message(4, message());
    return file.bytes(12, "proto3");
  }

 private:
  std::string_view word() {
    constexpr std::string_view kAlone = "{};=";
    while (at_ < text_.size() && std::isspace(static_cast<unsigned char>(text_[at_])) != 0) ++at_;
    const std::size_t begin = at_;
    if (at_ < text_.size() && kAlone.find(text_[at_]) != std::string_view::npos) return text_.substr(at_++, 1);
    while (at_ < text_.size() && std::isspace(static_cast<unsigned char>(text_[at_])) == 0 &&
           kAlone.find(text_[at_]) == std::string_view::npos) {
      ++at_;
    }
    return text_.substr(begin, at_ - begin);
  }
  std::uint64_t numberAfterEquals() {
    (void)word();
    const std::string_view digits = word();
    std::uint64_t number = 0;
    std::from_chars(digits.data(), digits.data() + digits.size(), number);
    (void)word();  // the semicolon
    return number;
  }

  ProtobufMessage message() {
    ProtobufMessage message;
    const std::string name(word());
    message.bytes(1, name);
    (void)word();
    std::string own_enum;
    for (std::string_view next = word(); next != "}"; next = word()) {
      if (next == "enum") {
        own_enum = word();
        message.message(4, enumeration(own_enum));
        continue;
      }
      const bool repeated = next == "repeated";
      const std::string type(repeated ? word() : next);
      message.message(2, field(type, repeated, type == own_enum ? name + "." + type : std::string()));
    }
    return message;
  }

  ProtobufMessage enumeration(const std::string& name) {
    ProtobufMessage made;
    made.bytes(1, name);
    (void)word();
    for (std::string_view next = word(); next != "}"; next = word()) {
      const std::string value(next);
      made.message(2, ProtobufMessage().bytes(1, value).whole(2, numberAfterEquals()));
    }
    return made;
  }

  /// @param own_enum  its name in the package, if the type is one
  ProtobufMessage field(const std::string& type, bool repeated, const std::string& own_enum) {
    constexpr std::pair<std::string_view, int> kTypes[] = {{"double", 1}, {"int64", 3},  {"int32", 5}, {"fixed32", 7},
                                                           {"bool", 8},   {"string", 9}, {"bytes", 12}};
    constexpr int kMessageType = 11, kEnumType = 14;
    const std::string name(word());
    ProtobufMessage field;
    field.bytes(1, name).whole(3, numberAfterEquals()).whole(4, repeated ? 3 : 1);
    for (const auto& [word, number] : kTypes) {
      if (type == word) return field.whole(5, static_cast<std::uint64_t>(number));
    }
    if (!own_enum.empty()) return field.whole(5, kEnumType).bytes(6, "." + package_ + "." + own_enum);
    const bool of_google = type == "Timestamp" || type == "Duration";
    return field.whole(5, kMessageType).bytes(6, "." + (of_google ? "google.protobuf" : package_) + "." + type);
  }

  std::string_view text_;
  std::string package_;
  std::size_t at_ = 0;
};

}  // namespace

std::string foxgloveDescriptors() {
  constexpr std::string_view kTimestampFile = "google/protobuf/timestamp.proto",
                             kDurationFile = "google/protobuf/duration.proto";
  ProtobufMessage set;
  set.message(1, DescriptorWriter(kTimestamp, "google.protobuf").file(kTimestampFile, {}));
  set.message(1, DescriptorWriter(kDuration, "google.protobuf").file(kDurationFile, {}));
  set.message(1, DescriptorWriter(kMessages, "foxglove").file("foxglove.proto", {kTimestampFile, kDurationFile}));
  return set.encoded();
}

}  // namespace accessvdb::io
