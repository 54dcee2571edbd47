// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "sim/mesh_ply.h"

#include <bit>
#include <cstring>
#include <ostream>
#include <string>

#include "accessvdb/field_io.h"

namespace accessvdb::sim {

static_assert(std::endian::native == std::endian::little, "written directly from memory");
static_assert(sizeof(Eigen::Vector3f) == 12, "a vertex is three packed floats");

void writeMeshPly(const std::filesystem::path& path, const TriangleMesh& mesh) {
  io::writeFileDurably(path, [&](std::ostream& out) {
    out << "ply\nformat binary_little_endian 1.0\ncomment metres, world frame, z up\nelement vertex "
        << mesh.vertices_W.size() << "\nproperty float x\nproperty float y\nproperty float z\nelement face "
        << mesh.triangles.size() << "\nproperty list uchar int vertex_indices\nend_header\n";
    out.write(reinterpret_cast<const char*>(mesh.vertices_W.data()),
              static_cast<std::streamsize>(mesh.vertices_W.size() * sizeof(Eigen::Vector3f)));
    constexpr std::size_t kFaceBytes = 1 + 3 * sizeof(std::uint32_t);
    std::string faces(mesh.triangles.size() * kFaceBytes, '\3');
    for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
      std::memcpy(faces.data() + i * kFaceBytes + 1, mesh.triangles[i].data(), 3 * sizeof(std::uint32_t));
    }
    out.write(faces.data(), static_cast<std::streamsize>(faces.size()));
  });
}

}  // namespace accessvdb::sim
