// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A scene's mesh as a file that viewers, CAD and --tool read.
#pragma once

#include <filesystem>

#include "sim/triangle_mesh.h"

namespace accessvdb::sim {

/// Binary little-endian PLY, metres, world frame; whole or not at all. @throws OutputError
void writeMeshPly(const std::filesystem::path& path, const TriangleMesh& mesh);

}  // namespace accessvdb::sim
