// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Pose files that plans keep in their folders, once poses were corrected.
#include <algorithm>
#include <ostream>
#include <set>

#include "accessvdb/field_io.h"
#include "accessvdb/program/path_facts.h"
#include "accessvdb/tiles.h"
#include "io/streams/exact_text.h"

namespace accessvdb::tiles {
namespace {

namespace fs = std::filesystem;

std::string nameOf(int number) { return "poses-" + std::to_string(number) + ".txt"; }

/// Whether a pose file can name this one in a column.
bool isOneWord(const std::string& file) {
  constexpr std::string_view kNot = ",;\"'#%/\\";
  return std::all_of(file.begin(), file.end(), [&](char c) {
    return static_cast<unsigned char>(c) > ' ' && c != '\x7f' && kNot.find(c) == std::string_view::npos;
  });
}

}  // namespace

std::string writePosesInEffect(const fs::path& out, std::vector<ScanPose> poses) {
  const bool stamped = std::all_of(poses.begin(), poses.end(), [](const ScanPose& p) { return p.stamp_s.has_value(); });
  bool timed = stamped;
  if (stamped) {
    // A pose file's stamps increase, whatever the order of the scans.
    std::stable_sort(poses.begin(), poses.end(),
                     [](const ScanPose& a, const ScanPose& b) { return *a.stamp_s < *b.stamp_s; });
    const auto again = [](const ScanPose& a, const ScanPose& b) { return *a.stamp_s == *b.stamp_s; };
    timed = std::adjacent_find(poses.begin(), poses.end(), again) == poses.end();
  }
  std::set<std::string> names;
  bool named = true;
  for (const ScanPose& pose : poses) {
    named = named && !pose.file.empty() && isOneWord(pose.file) && names.insert(pose.file).second;
  }
  if (poses.empty() || (!named && !timed)) return {};
  int number = 1;
  while (io::isTaken(out / nameOf(number), ErrorCode::Output)) ++number;
  io::writeFileDurably(out / nameOf(number), [&](std::ostream& stream) {
    stream << "# accessvdb tile plan\n" << (named ? "file " : "") << (timed ? "timestamp " : "");
    stream << "m00 m01 m02 m03 m10 m11 m12 m13 m20 m21 m22 m23\n";
    for (const ScanPose& pose : poses) {
      if (named) stream << pose.file << " ";
      if (timed) stream << internal::exactText(*pose.stamp_s) << " ";
      for (Eigen::Index n = 0; n < 12; ++n) {
        stream << internal::exactText(pose.T_W_S(n / 4, n % 4)) << (n < 11 ? " " : "\n");
      }
    }
  });
  return nameOf(number);
}

}  // namespace accessvdb::tiles
