// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Tools that need no file.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace accessvdb::internal {

/// Triangles in the tool frame, metres. Every shell is closed; shells may overlap.
struct BuiltinMesh {
  std::vector<Eigen::Vector3f> vertices_T;
  std::vector<std::array<std::uint32_t, 3>> triangles;
};

/// @throws InvalidArgument for a name other than "builtin:pencil" and "builtin:pruner"
BuiltinMesh builtinMesh(const std::string& name);

}  // namespace accessvdb::internal
