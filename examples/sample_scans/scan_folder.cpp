// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "sample_scans/scan_folder.h"

#include <bit>
#include <cstdio>
#include <fstream>
#include <set>
#include <string>
#include <system_error>

#include "accessvdb/error.h"

namespace accessvdb::samples {
namespace {

static_assert(std::endian::native == std::endian::little, "binary PCD is written directly from memory");
static_assert(sizeof(Eigen::Vector3f) == 12, "a row of a PCD is three packed floats");

template <typename... Values>
std::string formatted(const char* format, Values... values) {
  char text[512];
  std::snprintf(text, sizeof(text), format, values...);
  return text;
}

std::string scanName(const WalkGenerator& walk, ScanNames names, int index) {
  if (names == ScanNames::FrameNumber) return formatted("%06d.pcd", index);
  return formatted("%017.6f.pcd", walk.options().frame_period_s * index);
}

void writeFile(const std::filesystem::path& path, const std::string& content) {
  std::ofstream stream(path, std::ios::binary | std::ios::trunc);
  stream.write(content.data(), static_cast<std::streamsize>(content.size()));
  stream.close();
  if (!stream)
    throw OutputError("sample.write", path.string(), "cannot be written", "Check free space and permissions");
}

std::string pcd(const std::vector<Eigen::Vector3f>& points) {
  const std::string n = std::to_string(points.size());
  std::string content =
      "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 "
      "1\nWIDTH " +
      n + "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " + n + "\nDATA binary\n";
  content.append(reinterpret_cast<const char*>(points.data()), points.size() * sizeof(Eigen::Vector3f));
  return content;
}

}  // namespace

void writeScanFolder(const std::filesystem::path& folder, const WalkGenerator& walk, ScanNames names,
                     const std::function<void(int)>& progress) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error)
    throw OutputError("sample.folder", folder.string(), "cannot be created: " + error.message(), "Choose another");

  // A scan left over from another run would be matched to a pose of this one.
  std::set<std::string> own;
  for (int i = 0; i < walk.frames(); ++i) own.insert(scanName(walk, names, i));
  for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
    const std::string file = entry.path().filename().string();
    if (entry.path().extension() == ".pcd" && !own.contains(file)) {
      throw OutputError("sample.mixed", folder.string(), "already contains other scans, for example " + file,
                        "Choose an empty folder");
    }
  }
  if (error)
    throw OutputError("sample.folder", folder.string(), "cannot be listed: " + error.message(), "Choose another");

  std::string poses = "# stamp x y z qx qy qz qw, sensor to world, metres\n";
  for (int i = 0; i < walk.frames(); ++i) {
    const WalkFrame frame = walk.frame(i);
    writeFile(folder / scanName(walk, names, i), pcd(frame.points_S));
    const Eigen::Vector3d t = frame.T_W_S.translation();
    const Eigen::Quaterniond q(frame.T_W_S.linear());
    poses += formatted("%.6f %.12g %.12g %.12g %.15g %.15g %.15g %.15g\n", frame.stamp_s, t.x(), t.y(), t.z(), q.x(),
                       q.y(), q.z(), q.w());
    if (progress) progress(i + 1);
  }
  writeFile(folder / "poses.txt", poses);
  writeFile(folder / "range_noise.txt", formatted("%.9g\n", walk.options().range_noise_m));
}

}  // namespace accessvdb::samples
