// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "accessvdb/scan_io.h"
#include "io/streams/input_file.h"
#include "io/streams/text_lines.h"

namespace accessvdb::io {
namespace {

constexpr std::array<std::string_view, 7> kColumns = {"x", "y", "z", "qw", "qx", "qy", "qz"};
constexpr const char* kAdvice = "Write one 'x y z qw qx qy qz' per line: the tip in metres, and a unit quaternion";
/// Of a quaternion as text.
constexpr double kSlackOfLength = 1e-3;

using Columns = std::array<std::size_t, kColumns.size()>;

/// By a line of names.
Columns columnsOf(const LineReader& lines, const std::vector<std::string_view>& names) {
  Columns columns = {};
  for (std::size_t n = 0; n < kColumns.size(); ++n) {
    const auto found =
        std::ranges::find_if(names, [&](std::string_view name) { return inLowerCase(name) == kColumns[n]; });
    if (found == names.end()) lines.fail("has no column " + std::string(kColumns[n]), kAdvice);
    columns[n] = static_cast<std::size_t>(found - names.begin());
  }
  return columns;
}

}  // namespace

std::vector<Eigen::Isometry3d> readToolPoses(const std::filesystem::path& path) {
  const std::string file = readInputFile(path);
  LineReader lines(file, forMessage(path.native()));
  Columns columns = {0, 1, 2, 3, 4, 5, 6};
  std::size_t count = kColumns.size();
  std::vector<Eigen::Isometry3d> poses;
  std::vector<std::string_view> tokens;
  bool first = true;
  for (std::string_view line; lines.next(line);) {
    if (isBlankOrComment(line)) continue;
    lines.splitNumbers(line, tokens);
    double value = 0;
    if (std::exchange(first, false) && !tokens.empty() && !parseNumber(tokens.front(), value)) {
      columns = columnsOf(lines, tokens);
      count = tokens.size();
      continue;
    }
    std::array<double, kColumns.size()> numbers = {};
    bool fine = tokens.size() == count;
    for (std::size_t n = 0; fine && n < numbers.size(); ++n)
      fine = parseNumber(tokens[columns[n]], numbers[n]) && std::isfinite(numbers[n]);
    if (!fine) lines.fail("is not seven finite numbers", kAdvice);
    const Eigen::Quaterniond q(numbers[3], numbers[4], numbers[5], numbers[6]);
    if (!(std::abs(q.norm() - 1) <= kSlackOfLength)) lines.fail("has a quaternion that is no rotation", kAdvice);
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    pose.translation() = Eigen::Vector3d(numbers[0], numbers[1], numbers[2]);
    pose.linear() = q.normalized().toRotationMatrix();
    poses.push_back(pose);
  }
  return poses;
}

}  // namespace accessvdb::io
