// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// own_tool: what can a tool of your own reach?
///   own_tool                                        a gripper made of triangles, in code
///   own_tool MESH UNIT TIPX TIPY TIPZ AX AY AZ      a mesh file (STL, OBJ, PLY, glTF, ...); UNIT: m, cm, mm or in
/// TIP is where the tool touches, A the direction from the tip along the body, both in the mesh's own units and axes.
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/error.h"
#include "sample_scans/walk_generator.h"

namespace {

using accessvdb::InvalidArgument;
using accessvdb::LengthUnit;
using accessvdb::ToolGeometry;

/// Adds a box to a mesh. The tool frame: metres, tip at the origin, +x from the tip along the body, +z up.
void addBox(const Eigen::Vector3f& low, const Eigen::Vector3f& high, std::vector<Eigen::Vector3f>& vertices_T,
            std::vector<std::array<std::uint32_t, 3>>& triangles) {
  const auto first = static_cast<std::uint32_t>(vertices_T.size());
  for (int n = 0; n < 8; ++n) {
    vertices_T.emplace_back((n & 1) != 0 ? high.x() : low.x(), (n & 2) != 0 ? high.y() : low.y(),
                            (n & 4) != 0 ? high.z() : low.z());
  }
  constexpr std::uint32_t kFaces[12][3] = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                                           {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  for (const auto& face : kFaces) triangles.push_back({first + face[0], first + face[1], first + face[2]});
}

/// Two fingers, and a palm 12 cm behind the tip.
ToolGeometry gripper() {
  std::vector<Eigen::Vector3f> vertices_T;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  addBox({0.0f, 0.02f, -0.01f}, {0.12f, 0.035f, 0.01f}, vertices_T, triangles);
  addBox({0.0f, -0.035f, -0.01f}, {0.12f, -0.02f, 0.01f}, vertices_T, triangles);
  addBox({0.12f, -0.06f, -0.03f}, {0.25f, 0.06f, 0.03f}, vertices_T, triangles);
  return ToolGeometry::fromTriangles(vertices_T, triangles, "gripper");
}

LengthUnit unitOf(const std::string& text) {
  if (text == "m") return LengthUnit::Metre;
  if (text == "cm") return LengthUnit::Centimetre;
  if (text == "mm") return LengthUnit::Millimetre;
  if (text == "in") return LengthUnit::Inch;
  throw InvalidArgument("example.unit", text, "is not a unit", "Use m, cm, mm or in");
}

Eigen::Vector3d vectorOf(char** texts) {
  Eigen::Vector3d v;
  for (int axis = 0; axis < 3; ++axis) {
    char* end = nullptr;
    v[axis] = std::strtod(texts[axis], &end);
    if (end == texts[axis] || *end != '\0' || !std::isfinite(v[axis])) {
      throw InvalidArgument("example.number", texts[axis], "is not a finite number");
    }
  }
  return v;
}

ToolGeometry toolOf(int argc, char** argv) {
  if (argc == 1) return gripper();
  if (argc != 9) {
    throw InvalidArgument("example.arguments", "", "pass nothing, or MESH UNIT TIPX TIPY TIPZ AX AY AZ");
  }
  accessvdb::ToolPose pose;
  pose.tip = vectorOf(argv + 3);
  pose.axis = vectorOf(argv + 6);
  if (pose.axis.cross(pose.up).norm() < 1e-6 * pose.axis.norm()) pose.up = Eigen::Vector3d(0, 1, 0);
  return ToolGeometry::fromMesh(argv[1], unitOf(argv[2]), pose);
}

void run(int argc, char** argv) {
  const ToolGeometry tool = toolOf(argc, argv);
  const Eigen::Vector3f size_m = tool.max_T() - tool.min_T();
  std::printf("tool %s: %.3f x %.3f x %.3f m, reaches %.3f m from its tip\n", tool.name().c_str(), size_m.x(),
              size_m.y(), size_m.z(), tool.reach_m());
  for (const std::string& note : tool.notes()) std::printf("note: %s\n", note.c_str());

  accessvdb::AccessibilityField field(tool, {.tsdf = {.voxel_size_m = 0.05}});
  const accessvdb::samples::WalkGenerator walk({.frames = 4, .rays_per_frame = 8000, .max_range_m = 8});
  for (int n = 0; n < walk.frames(); ++n) {
    const accessvdb::samples::WalkFrame frame = walk.frame(n);
    field.integrateScan(frame.points_S, frame.T_W_S);
  }
  field.update();
  const accessvdb::FieldSnapshot snapshot = field.snapshot();
  const auto accessible = static_cast<unsigned long long>(snapshot.count(accessvdb::PointLabel::Accessible));
  const auto blocked = static_cast<unsigned long long>(snapshot.count(accessvdb::PointLabel::Blocked));
  std::printf("accessible %llu\nblocked %llu\n", accessible, blocked);
}

}  // namespace

int main(int argc, char** argv) {
  try {
    run(argc, argv);
    return 0;
  } catch (const accessvdb::Error& error) {
    std::fprintf(stderr, "own_tool: %s\n", error.what());
    return error.exitCode();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "own_tool: %s\n", error.what());
    return static_cast<int>(accessvdb::ErrorCode::Internal);
  }
}
