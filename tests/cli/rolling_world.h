// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A sensor that moves along a long wall: more map than one place needs.
#pragma once

#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <random>
#include <string>
#include <vector>

namespace accessvdb::cli_test {

struct RollingWorld {
  int scans = 40;
  double step_m = 1;
  int returns = 4000;         ///< of each scan
  bool returns_home = false;  ///< the second half goes back
  bool boards_go = false;     ///< boards stand 1 m before the wall, in the first half of the scans
};

/// Binary PCD scans into FOLDER/scans and TUM poses into FOLDER/poses.txt: a rough wall with recesses, 3 m away.
inline void writeRollingWorld(const RollingWorld& world, const std::filesystem::path& folder) {
  std::filesystem::create_directories(folder / "scans");
  std::ofstream poses(folder / "poses.txt");
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> along(-5, 5), up(-1.5, 1.5);
  for (int scan = 0; scan < world.scans; ++scan) {
    const int place = world.returns_home && 2 * scan > world.scans ? world.scans - scan : scan;
    const double sensor_y = world.step_m * place;
    std::vector<std::array<float, 3>> points_S;
    for (int n = 0; n < world.returns; ++n) {
      const double y = sensor_y + along(random), z = up(random);
      const double recess = std::abs(std::remainder(y, 4.0)) < 0.15 ? 0.5 : 0;
      double x = 3 + recess + 0.05 * std::sin(7 * y + 5 * z), part = 1;
      if (world.boards_go && 2 * scan < world.scans) {
        // Where the ray meets the plane of the boards.
        const double y_board = sensor_y + 2 / x * (y - sensor_y), z_board = 2 / x * z;
        if (std::abs(std::remainder(y_board, 2.5)) < 0.4 && std::abs(z_board) < 0.3) part = 2 / x;
      }
      points_S.push_back(
          {static_cast<float>(part * x), static_cast<float>(part * (y - sensor_y)), static_cast<float>(part * z)});
    }
    char name[64];
    std::snprintf(name, sizeof name, "%06d.pcd", scan);
    const std::string count = std::to_string(points_S.size());
    std::ofstream file(folder / "scans" / name, std::ios::binary);
    file << "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH " << count
         << "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " << count << "\nDATA binary\n";
    file.write(reinterpret_cast<const char*>(points_S.data()),
               static_cast<std::streamsize>(points_S.size() * sizeof points_S[0]));
    char pose[96];
    std::snprintf(pose, sizeof pose, "%d 0 %.6f 0 0 0 0 1\n", scan, sensor_y);
    poses << pose;
  }
}

/// map of such a world in FOLDER. @param more  the other flags
inline std::vector<std::string> mapOfRollingWorld(const std::filesystem::path& folder, std::vector<std::string> more) {
  // clang-format off
  more.insert(more.begin(), {"map", "--scans", folder / "scans", "--poses", folder / "poses.txt", "--tool", "builtin:pruner",
                             "--voxel", "0.05", "--range-noise", "0.01", "--max-range", "8", "--device", "cpu"});
  // clang-format on
  return more;
}

}  // namespace accessvdb::cli_test
