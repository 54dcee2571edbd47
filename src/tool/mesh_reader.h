// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Reads an untrusted mesh file: checks before, assimp in a child process with limits, checks after.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace accessvdb::internal {

/// The content of a file, all nodes placed, in the file's own axes.
struct FileMesh {
  std::vector<Eigen::Vector3f> vertices;                ///< finite
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< indices are in range; at least one triangle
  double metres_per_file_unit = 0;                      ///< 0 = the format has no unit
  double metres_per_vertex_unit = 0;                    ///< for the vertices above; 0 = the format has no unit
  std::vector<std::string> notes;
};

/// @throws InputError (unreadable, malformed, an unsupported format), UnusableInput (no faces, not finite)
FileMesh readMeshFile(const std::filesystem::path& path);

}  // namespace accessvdb::internal
