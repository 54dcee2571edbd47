// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/poses/pose_files.h"

#include <algorithm>
#include <cmath>

#include "accessvdb/error.h"
#include "io/poses/pose_checks.h"
#include "io/streams/input_file.h"
#include "io/streams/text_lines.h"

namespace accessvdb::io {
namespace {

/// One line of numbers.
struct Row {
  std::vector<double> values;
  std::size_t line;
};

/// Poses closer than this are the same pose written twice.
constexpr double kSamePose = 1e-9;

std::vector<Row> readRows(const std::filesystem::path& path, const std::string& subject) {
  const std::string file = readInputFile(path);
  LineReader lines(file, subject);
  std::vector<Row> rows;
  std::string_view line;
  std::vector<std::string_view> tokens;
  while (lines.next(line)) {
    if (isBlankOrComment(line)) continue;
    splitTokens(line, tokens);
    Row row{{}, lines.number()};
    for (const std::string_view token : tokens) {
      double value = 0;
      if (!parseNumber(token, value))
        lines.fail("has '" + wordForMessage(token) + "' where a number is needed",
                   "Pose files are plain numbers: TUM, KITTI, BALM or HBA");
      row.values.push_back(value);
    }
    rows.push_back(std::move(row));
  }
  if (rows.empty())
    throw UnusableInput("poses.none", subject, "contains no poses", "Use the pose file that belongs to the scans");
  return rows;
}

PoseFormat formatOf(const std::vector<Row>& rows, const std::string& subject) {
  const std::size_t width = rows.front().values.size();
  if (width == 8) return PoseFormat::Tum;
  if (width == 12) return PoseFormat::Kitti;
  if (width == 7) return PoseFormat::Hba;
  if (width == 4 && rows.size() % 4 == 0) return PoseFormat::Balm;
  throw InputError("input.malformed", subject,
                   "line " + std::to_string(rows.front().line) + " has " + std::to_string(width) +
                       " numbers, which is not a known pose format",
                   "Known formats are TUM (8 numbers), KITTI (12), HBA (7) and BALM (4 lines of 4)");
}

void requireWidth(const std::vector<Row>& rows, std::size_t width, const std::string& subject) {
  for (const Row& row : rows)
    if (row.values.size() != width)
      throw InputError("input.malformed", subject,
                       "line " + std::to_string(row.line) + " has " + std::to_string(row.values.size()) +
                           " numbers, but this format needs " + std::to_string(width),
                       "Check the line and pose_format");
}

void readTum(const std::vector<Row>& rows, PoseFile& file, PoseChecker& checker) {
  requireWidth(rows, 8, file.subject);
  for (const Row& row : rows) {
    const auto& v = row.values;
    PoseEntry pose;
    pose.T_W_S = checker.fromQuaternion({v[1], v[2], v[3]}, {v[7], v[4], v[5], v[6]}, row.line);
    pose.stamp_s = v[0];
    pose.line = row.line;
    file.poses.push_back(pose);
  }
  file.stamped = true;
  file.notices.push_back("poses: TUM, sensor to world, quaternion order x y z w");
}

void readHba(const std::vector<Row>& rows, PoseFile& file, PoseChecker& checker) {
  requireWidth(rows, 7, file.subject);
  for (const Row& row : rows) {
    const auto& v = row.values;
    PoseEntry pose;
    pose.T_W_S = checker.fromQuaternion({v[0], v[1], v[2]}, {v[3], v[4], v[5], v[6]}, row.line);
    pose.line = row.line;
    file.poses.push_back(pose);
  }
  file.notices.push_back("poses: HBA/MLCC, sensor to world, quaternion order w x y z");
}

Eigen::Matrix<double, 3, 4> matrixOf(const double* v) {
  return Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>>(v);
}

void readKitti(const std::vector<Row>& rows, PoseFile& file, PoseChecker& checker) {
  requireWidth(rows, 12, file.subject);
  for (const Row& row : rows) {
    PoseEntry pose;
    pose.T_W_S = checker.fromMatrix(matrixOf(row.values.data()), row.line);
    pose.line = row.line;
    file.poses.push_back(pose);
  }
}

void readBalm(const std::vector<Row>& rows, PoseFile& file, PoseChecker& checker) {
  requireWidth(rows, 4, file.subject);
  if (rows.size() % 4 != 0)
    throw InputError("input.malformed", file.subject,
                     "has " + std::to_string(rows.size()) + " lines of numbers, but BALM needs 4 per pose",
                     "Copy the file again");
  // Plain 4x4 matrices have 1 where BALM stores the time.
  bool all_one = true;
  for (std::size_t i = 0; i < rows.size(); i += 4) {
    std::array<double, 12> m;
    for (std::size_t r = 0; r < 3; ++r) std::copy_n(rows[i + r].values.begin(), 4, m.begin() + 4 * r);
    const auto& last = rows[i + 3].values;
    if (!(last[0] == 0 && last[1] == 0 && last[2] == 0))
      throw InputError(
          "input.malformed", file.subject,
          "line " + std::to_string(rows[i + 3].line) + " does not begin with 0 0 0 as the last row of a pose must",
          "Check the line and pose_format");
    PoseEntry pose;
    pose.T_W_S = checker.fromMatrix(matrixOf(m.data()), rows[i].line);
    pose.stamp_s = last[3];
    pose.line = rows[i].line;
    all_one = all_one && last[3] == 1;
    file.poses.push_back(pose);
  }
  file.stamped = !all_one;
  file.notices.push_back(std::string("poses: BALM, 4x4 matrices, sensor to world") +
                         (file.stamped ? ", time stamp in the last element" : ", no time stamps"));
}

/// T_velo = inv(Tr) P Tr: converts camera poses in the first camera frame to scanner poses in the first scanner frame.
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

bool samePose(const PoseEntry& a, const PoseEntry& b) {
  return (a.T_W_S.matrix() - b.T_W_S.matrix()).cwiseAbs().maxCoeff() <= kSamePose;
}

void checkStamps(PoseFile& file, bool sort_poses) {
  auto& poses = file.poses;
  for (const PoseEntry& pose : poses)
    if (!std::isfinite(pose.stamp_s))
      throw UnusableInput("poses.non_finite", file.subject,
                          "line " + std::to_string(pose.line) + " has a time stamp that is not finite",
                          "Remove or correct that pose");
  const auto backwards = [](const PoseEntry& a, const PoseEntry& b) { return a.stamp_s > b.stamp_s; };
  const auto reversed = std::adjacent_find(poses.begin(), poses.end(), backwards);
  if (reversed != poses.end()) {
    if (!sort_poses)
      throw UnusableInput("poses.reversed", file.subject,
                          "line " + std::to_string((reversed + 1)->line) + " is earlier than the pose before it",
                          "Use sort_poses to sort them by time");
    std::stable_sort(poses.begin(), poses.end(),
                     [](const PoseEntry& a, const PoseEntry& b) { return a.stamp_s < b.stamp_s; });
    file.notices.push_back("poses: sorted by their time stamps");
  }
  std::size_t repeats = 0;
  for (std::size_t i = 1; i < poses.size(); ++i) {
    if (poses[i].stamp_s != poses[i - 1].stamp_s) continue;
    if (!samePose(poses[i], poses[i - 1]))
      throw UnusableInput("poses.duplicate", file.subject,
                          "lines " + std::to_string(poses[i - 1].line) + " and " + std::to_string(poses[i].line) +
                              " have the same time stamp and different poses",
                          "Remove one of them");
    ++repeats;
  }
  // BALM poses are identified by their place, so repeats stay.
  if (repeats == 0 || file.format == PoseFormat::Balm) return;
  poses.erase(std::unique(poses.begin(), poses.end(),
                          [](const PoseEntry& a, const PoseEntry& b) { return a.stamp_s == b.stamp_s; }),
              poses.end());
  file.notices.push_back("poses: " + std::to_string(repeats) + " repeated poses were dropped");
}

}  // namespace

PoseFile readPoseFile(const std::filesystem::path& path, PoseFormat format, const std::filesystem::path& calib,
                      bool sort_poses) {
  PoseFile file;
  file.subject = forMessage(path.native());
  const std::vector<Row> rows = readRows(path, file.subject);
  file.format = format == PoseFormat::Auto ? formatOf(rows, file.subject) : format;
  PoseChecker checker(file.subject);
  switch (file.format) {
    case PoseFormat::Tum:
      readTum(rows, file, checker);
      break;
    case PoseFormat::Hba:
      readHba(rows, file, checker);
      break;
    case PoseFormat::Kitti:
      readKitti(rows, file, checker);
      break;
    case PoseFormat::Balm:
      readBalm(rows, file, checker);
      break;
    case PoseFormat::Auto:
    case PoseFormat::Viewpoint:
      throw InvalidArgument("usage.pose_format", file.subject,
                            "a pose file and poses from VIEWPOINT exclude each other", "Omit one of the two");
  }
  checker.addNotice(file.notices);
  for (std::size_t i = 0; i < file.poses.size(); ++i) file.poses[i].index = i;
  if (file.stamped) checkStamps(file, sort_poses);
  if (!calib.empty()) {
    if (file.format != PoseFormat::Kitti)
      throw InvalidArgument("usage.calib", file.subject,
                            "a calibration applies to KITTI poses, but these have another format",
                            "Omit ScanInputOptions::calib or use pose_format kitti");
    applyCalibration(calib, file);
  } else if (file.format == PoseFormat::Kitti) {
    std::error_code error;
    const bool calib_near = std::filesystem::exists(path.parent_path() / "calib.txt", error);
    file.notices.push_back(
        std::string("poses: KITTI, 3x4 matrices, taken as poses of the scanner itself, sensor to world") +
        (calib_near
             ? "; there is a calib.txt next to them: pass it with ScanInputOptions::calib if they are camera poses"
             : ""));
  }
  return file;
}

std::vector<double> readTimes(const std::filesystem::path& path) {
  const std::string subject = forMessage(path.native());
  const std::string file = readInputFile(path);
  LineReader lines(file, subject);
  std::vector<double> times;
  std::string_view line;
  std::vector<std::string_view> tokens;
  while (lines.next(line)) {
    if (isBlankOrComment(line)) continue;
    splitTokens(line, tokens);
    double time = 0;
    if (tokens.size() != 1 || !parseNumber(tokens[0], time) || !std::isfinite(time))
      lines.fail("is not a single time in seconds");
    times.push_back(time);
  }
  return times;
}

}  // namespace accessvdb::io
