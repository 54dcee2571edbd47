// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Prints the vertices of a tool in the library's tool frame, "x y z" per line, metres, to compare the Blender add-on
/// with.  tool_vertices builtin:NAME | tool_vertices MESH mm TIP AXIS UP, each of the last X Y Z
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <string>

#include "accessvdb/tool_geometry.h"

namespace {

Eigen::Vector3d vectorAt(char** arguments) {
  return {std::atof(arguments[0]), std::atof(arguments[1]), std::atof(arguments[2])};
}

accessvdb::ToolGeometry toolOf(int count, char** arguments) {
  if (count == 2) return accessvdb::ToolGeometry::builtin(arguments[1]);
  accessvdb::ToolPose pose;
  pose.tip = vectorAt(arguments + 3);
  pose.axis = vectorAt(arguments + 6);
  pose.up = vectorAt(arguments + 9);
  return accessvdb::ToolGeometry::fromMesh(arguments[1], accessvdb::LengthUnit::Millimetre, pose);
}

}  // namespace

int main(int count, char** arguments) {
  if (count != 2 && count != 12) return 2;
  try {
    const accessvdb::ToolGeometry tool = toolOf(count, arguments);
    for (const Eigen::Vector3f& p_T : tool.vertices_T()) {
      std::printf("%.9g %.9g %.9g\n", p_T.x(), p_T.y(), p_T.z());
    }
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
