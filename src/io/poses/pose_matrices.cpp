// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Poses that are written as matrices.
#include <algorithm>
#include <array>
#include <set>

#include "io/poses/pose_rows.h"
#include "io/streams/input_file.h"
#include "io/streams/text_lines.h"

namespace accessvdb::io {
namespace {

Eigen::Matrix<double, 3, 4> matrixOf(const double* v) {
  return Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>>(v);
}

bool isNearlyRotation(const double* v) {
  const Eigen::Matrix3d r = matrixOf(v).leftCols<3>();
  return (r.transpose() * r - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() <= kRepairLimit;
}
/// Of 16 numbers: the last row of a matrix, whose last number may be a time (BALM).
bool endsByRow(const double* v) { return v[12] == 0 && v[13] == 0 && v[14] == 0; }
bool endsByColumn(const double* v) { return v[3] == 0 && v[7] == 0 && v[11] == 0 && v[15] == 1; }

template <typename Fits>
std::size_t countRows(const std::vector<PoseRow>& rows, const Fits& fits) {
  return static_cast<std::size_t>(std::count_if(rows.begin(), rows.end(), fits));
}

/// Whether the numbers beside matrices are those of scans: whole and small, each once. Else they are times.
bool areNumbers(const std::vector<PoseRow>& rows, std::size_t column) {
  constexpr double kMostScans = 1e9;
  std::set<double> seen;
  return std::all_of(rows.begin(), rows.end(), [&](const PoseRow& row) {
    const double value = row.values[column];
    return value >= 0 && value < kMostScans && value == std::floor(value) && seen.insert(value).second;
  });
}

/// Lines of 4, of which a pose takes three: most of them are then rotations.
bool areThreeLines(const std::vector<PoseRow>& rows) {
  if (rows.size() % 3 != 0) return false;
  const auto four = [](const PoseRow& row) { return row.values.size() == 4; };
  if (!std::all_of(rows.begin(), rows.end(), four)) return false;
  std::size_t last_rows = 0, rotations = 0;
  for (std::size_t i = 3; i < rows.size(); i += 4) {
    const auto& v = rows[i].values;
    last_rows += v[0] == 0 && v[1] == 0 && v[2] == 0 ? 1 : 0;
  }
  if (rows.size() % 4 == 0 && 8 * last_rows >= rows.size()) return false;  // BALM
  for (std::size_t i = 0; i < rows.size(); i += 3) {
    std::array<double, 12> m;
    for (std::size_t r = 0; r < 3; ++r) std::copy_n(rows[i + r].values.begin(), 4, m.begin() + 4 * r);
    rotations += isNearlyRotation(m.data()) ? 1 : 0;
  }
  return 6 * rotations >= rows.size();
}

/// Each fifth line has three whole numbers, the others 4.
bool isLog(const std::vector<PoseRow>& rows) {
  if (rows.size() % 5 != 0) return false;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const std::vector<double>& v = rows[i].values;
    if (v.size() != (i % 5 == 0 ? 3 : 4)) return false;
    if (i % 5 == 0 && !std::all_of(v.begin(), v.end(), [](double n) { return n == std::floor(n); })) return false;
  }
  return true;
}

}  // namespace

void joinLines(std::vector<PoseRow>& rows, PoseFormat format, PoseFile& file) {
  if (format != PoseFormat::Auto && format != PoseFormat::Kitti) return;
  const bool log = isLog(rows);
  if (!log && !areThreeLines(rows)) return;
  std::vector<PoseRow> joined;
  const std::size_t lines = log ? 5 : 3;
  for (std::size_t i = 0; i < rows.size(); i += lines) {
    PoseRow pose{{}, rows[i].line};
    if (log && rows[i].values[0] != rows[i].values[1])
      throw InputError("input.malformed", file.subject,
                       "line " + std::to_string(pose.line) +
                           " has the numbers of two scans: this is a .log of how pairs of scans lie to each other, not "
                           "of where each of them is",
                       "Use the .log of the trajectory");
    // The number of the scan stays, before its matrix.
    if (log) pose.values.push_back(rows[i].values[0]);
    for (std::size_t k = log ? 1 : 0; k < lines; ++k)
      pose.values.insert(pose.values.end(), rows[i + k].values.begin(), rows[i + k].values.end());
    joined.push_back(std::move(pose));
  }
  if (log && !areNumbers(joined, 0))
    for (PoseRow& pose : joined) pose.values.erase(pose.values.begin());
  rows = std::move(joined);
  file.notices.push_back(log ? "poses: a .log as Open3D writes it, five lines for each pose"
                             : "poses: three lines of four numbers for each pose");
}

void readMatrices(const std::vector<PoseRow>& rows, PoseFile& file, PoseRowReader& reader) {
  const std::size_t width = rows.front().values.size();
  const bool square = width == 16 || width == 17, more = width == 13 || width == 17;
  requireWidth(rows, square || more ? width : 12, file.subject);
  const std::size_t size = square ? 16 : 12;
  // Beside a matrix: first, unless only the first numbers are matrices.
  const std::size_t half = (rows.size() + 1) / 2;
  std::size_t begin = 0, extra = size;
  if (more && countRows(rows, [](const PoseRow& row) { return isNearlyRotation(row.values.data() + 1); }) >= half) {
    begin = 1;
    extra = 0;
  }
  const bool by_row = countRows(rows, [&](const PoseRow& row) { return endsByRow(row.values.data() + begin); }) >= half;
  const bool by_column = square && !by_row && countRows(rows, [&](const PoseRow& row) {
                                                return endsByColumn(row.values.data() + begin);
                                              }) >= half;
  if (square && !by_row && !by_column)
    throw InputError("input.malformed", file.subject,
                     "line " + std::to_string(rows.front().line) + " has " + std::to_string(width) +
                         " numbers, but they are no 4x4 matrix: neither its last row nor its last column is 0 0 0 1",
                     "Check the order of the numbers; commas that are decimal have to be points");
  const bool timed_square =
      square && by_row && !more && countRows(rows, [](const PoseRow& row) { return row.values[15] != 1; }) >= half;
  const bool numbers = more && areNumbers(rows, extra);
  for (const PoseRow& row : rows) {
    const double* const v = row.values.data() + begin;
    const double stamp_s = more && !numbers ? row.values[extra] : timed_square ? v[15] : 0;
    if (numbers) file.numbers.push_back(static_cast<std::uint64_t>(row.values[extra]));
    reader.add(row.line, stamp_s, [&](PoseChecker& checker) {
      const Eigen::Matrix4d columns =
          square ? Eigen::Matrix4d(Eigen::Map<const Eigen::Matrix4d>(v)) : Eigen::Matrix4d();
      const Eigen::Isometry3d pose =
          by_column ? checker.fromMatrix(Eigen::Matrix<double, 3, 4>(columns.topRows<3>()), row.line)
                    : checker.fromMatrix(matrixOf(v), row.line);
      if (square && !(by_row ? endsByRow(v) && (timed_square || v[15] == 1) : endsByColumn(v)))
        throw UnusableInput("poses.bad_rotation", file.subject,
                            "line " + std::to_string(row.line) + " has a matrix whose last row is not 0 0 0 1",
                            "Check the order of the numbers and the pose format");
      return pose;
    });
  }
  if (numbers)
    for (PoseEntry& pose : file.poses) pose.index = file.numbers[pose.index];
  file.numbered = numbers;
  file.stamped = (more && !numbers) || timed_square;
  if (width == 12) return;  // KITTI
  file.notices.push_back(std::string("poses: ") + (square ? "4x4" : "3x4") + " matrices of " + std::to_string(size) +
                         " numbers" +
                         (by_column ? ", column by column"
                          : square  ? ", row by row"
                                    : "") +
                         (numbers        ? ", with the number of the scan"
                          : more         ? ", with a time stamp"
                          : timed_square ? ", time stamp in the last element"
                                         : ""));
}

void readBalm(const std::vector<PoseRow>& rows, PoseFile& file, PoseRowReader& reader) {
  requireWidth(rows, 4, file.subject);
  if (rows.size() % 4 != 0)
    throw InputError("input.malformed", file.subject,
                     "has " + std::to_string(rows.size()) + " lines of numbers, but BALM needs 4 per pose",
                     "Copy the file again");
  for (std::size_t i = 0; i < rows.size(); i += 4) {
    std::array<double, 12> m;
    for (std::size_t r = 0; r < 3; ++r) std::copy_n(rows[i + r].values.begin(), 4, m.begin() + 4 * r);
    const auto& last = rows[i + 3].values;
    if (std::isfinite(last[0]) && !(last[0] == 0 && last[1] == 0 && last[2] == 0))
      throw InputError(
          "input.malformed", file.subject,
          "line " + std::to_string(rows[i + 3].line) + " does not begin with 0 0 0 as the last row of a pose must",
          "Check the line and pose_format");
    reader.add(rows[i].line, last[3],
               [&](PoseChecker& checker) { return checker.fromMatrix(matrixOf(m.data()), rows[i].line); });
  }
  // Plain 4x4 matrices have 1 where BALM stores the time.
  file.stamped =
      !std::all_of(file.poses.begin(), file.poses.end(), [](const PoseEntry& pose) { return pose.stamp_s == 1; });
  file.notices.push_back(std::string("poses: BALM, 4x4 matrices, sensor to world") +
                         (file.stamped ? ", time stamp in the last element" : ", no time stamps"));
}

void applyCalibration(const std::filesystem::path& path, PoseFile& file) {
  const std::string text = readInputFile(path);
  LineReader lines(text, forMessage(path.native()));
  std::string_view line;
  std::vector<std::string_view> tokens;
  while (lines.next(line)) {
    splitTokens(line, tokens);
    if (tokens.empty() || (tokens[0] != "Tr:" && tokens[0] != "Tr_velo_to_cam:" && tokens[0] != "Tr_velo_cam:"))
      continue;
    std::array<double, 12> v;
    bool good = tokens.size() == 13;
    for (std::size_t i = 0; good && i < 12; ++i) good = parseNumber(tokens[i + 1], v[i]);
    if (!good) lines.fail("needs 12 numbers after " + wordForMessage(tokens[0]));
    PoseChecker checker(lines.subject());
    const Eigen::Isometry3d T_C_S = checker.fromMatrix(matrixOf(v.data()), lines.number());
    checker.addNotice(file.notices);
    for (PoseEntry& pose : file.poses) pose.T_W_S = T_C_S.inverse() * pose.T_W_S * T_C_S;
    file.notices.push_back("poses: KITTI camera poses, converted to scanner poses with Tr from " + lines.subject() +
                           "; the world is the first scanner frame");
    return;
  }
  throw InputError("input.malformed", lines.subject(), "has no line 'Tr:' with 12 numbers",
                   "Use KITTI's calib.txt of the sequence");
}

}  // namespace accessvdb::io
