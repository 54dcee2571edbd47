// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Scans for runs that are stopped: each has another content, so that none can stand for another.
#pragma once

#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

namespace accessvdb::cli_test {

struct CheckpointWorld {
  int points_a_side = 60;
};

/// Scans `first` to `first + count - 1` of a world, as binary PCD files of a rough wall with a slot in it and a pole
/// before it, all of which move with the sensor: these scans do not agree (--allow-disagreement).
inline void writeScansOf(const CheckpointWorld& world, const std::filesystem::path& folder, int first, int count) {
  std::filesystem::create_directories(folder);
  for (int scan = first; scan < first + count; ++scan) {
    std::vector<std::array<float, 3>> points_S;
    for (int row = 0; row < world.points_a_side; ++row) {
      for (int column = 0; column < world.points_a_side; ++column) {
        const double y = -0.5 + (column + 0.5) / world.points_a_side + 1e-3 * (scan % 7);
        const double z = -0.5 + (row + 0.5) / world.points_a_side + 1e-3 * (scan % 5);
        const double depth = std::abs(y) < 0.04 ? 2.4 : std::abs(y - 0.3) < 0.05 ? 1.6 : 2;
        const double x = depth + 0.01 * std::sin(31 * y + 17 * z + scan);
        points_S.push_back({static_cast<float>(x), static_cast<float>(y), static_cast<float>(z)});
      }
    }
    char name[64];
    std::snprintf(name, sizeof name, "%06d.000000.pcd", 100 + scan);
    const std::string count_text = std::to_string(points_S.size());
    std::ofstream file(folder / name, std::ios::binary);
    file << "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH " << count_text
         << "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " << count_text << "\nDATA binary\n";
    file.write(reinterpret_cast<const char*>(points_S.data()),
               static_cast<std::streamsize>(points_S.size() * sizeof points_S[0]));
  }
}

inline std::string contentOf(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// What a run writes, but for report.json, which has times.
inline const std::vector<std::string>& comparedOutputs() {
  static const std::vector<std::string> names = {"field.vdb", "field_points.vdb", "points.ply", "preview.png"};
  return names;
}

}  // namespace accessvdb::cli_test
