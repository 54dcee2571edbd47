// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A mesh file as bytes, and what can be determined before a parser sees it.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace accessvdb::internal {

enum class MeshFormat { Stl, Obj, Ply, Off, Collada, Gltf, Glb };

struct MeshFile {
  MeshFormat format = MeshFormat::Stl;
  std::string extension;  ///< lower case, without the dot
  std::string bytes;
  std::optional<std::uint64_t> expected_faces;  ///< face count announced by the file, if any
  double metres_per_unit = 0;                   ///< 0 = the format has no unit
  std::vector<std::string> notes;
};

/// Largest file that is read, and largest side file of a .gltf.
inline constexpr std::uint64_t kMaxMeshFileBytes = std::uint64_t{256} << 20;

/// Content of a regular file; never waits on a pipe or device. Nothing if there is none of at most max_bytes.
std::optional<std::string> readRegularFile(const std::filesystem::path& path, std::uint64_t max_bytes,
                                           std::string& problem);

/// @throws InputError with the reason in words
MeshFile openMeshFile(const std::filesystem::path& path);

}  // namespace accessvdb::internal
