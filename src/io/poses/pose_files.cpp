// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/poses/pose_files.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "accessvdb/error.h"
#include "accessvdb/program/path_facts.h"
#include "io/clouds/point_times.h"
#include "io/poses/column_reader.h"
#include "io/poses/pose_rows.h"
#include "io/streams/input_file.h"
#include "io/streams/text_lines.h"

namespace accessvdb::io {
namespace {

constexpr const char* kKnownFormats =
    "Known formats are TUM (8 numbers), KITTI (12), 4x4 matrices (16), both with a time (13, 17), HBA (7), BALM (4 "
    "lines of 4), 3 lines of 4 and Open3D's .log; others need a first line of column names such as timestamp x y z qx "
    "qy qz qw";

constexpr ColumnReader::Wanted kPoseColumns = {
    .id = "poses",
    .what = "Pose files are plain numbers: TUM, KITTI, BALM or HBA, or columns that a first line names",
    .names = "x y z and qx qy qz qw, or a matrix",
    .pose = true,
    .counted = true};

struct PoseTable {
  std::vector<PoseRow> rows;  ///< with names, only what they say: time, number, and x y z qw qx qy qz or a matrix
  std::optional<NamedColumns> names;
  std::string names_text;
};

/// The order in which rows of named columns are kept.
std::vector<std::size_t> neededColumns(const NamedColumns& names) {
  std::vector<std::size_t> columns;
  if (names.hasMatrix()) {
    columns.assign(names.matrix.begin(), names.matrix.end());
  } else {
    columns.assign(names.position.begin(), names.position.end());
    columns.insert(columns.end(), names.quaternion.begin(), names.quaternion.end());
  }
  return columns;
}

PoseTable readTable(const std::filesystem::path& path, PoseFile& file) {
  const std::string text = readInputFile(path);
  LineReader lines(text, file.subject);
  ColumnReader reader(lines, kPoseColumns);
  PoseTable table;
  while (reader.next()) {
    PoseRow row{{}, reader.line()};
    if (reader.names()) {
      const NamedColumns& names = *reader.names();
      double time_s = names.hasTime() ? reader.number(names.time) : 0;
      if (names.nanoseconds != NamedColumns::kNone) time_s += 1e-9 * reader.number(names.nanoseconds);
      row.values = {time_s, names.index == NamedColumns::kNone || names.hasTime() ? 0 : reader.number(names.index)};
      if (names.file != NamedColumns::kNone)
        file.scan_names.emplace_back(names.file < reader.cells().size() ? reader.cells()[names.file] : "");
      for (const std::size_t column : neededColumns(names)) row.values.push_back(reader.number(column));
    } else {
      for (std::size_t column = 0; column < reader.cells().size(); ++column)
        row.values.push_back(reader.number(column));
    }
    table.rows.push_back(std::move(row));
  }
  if (table.rows.empty())
    throw UnusableInput("poses.none", file.subject, "contains no poses", "Use the pose file that belongs to the scans");
  table.names = reader.names();
  table.names_text = reader.namesInWords();
  file.notices = reader.notices();
  return table;
}

PoseFormat formatOf(const std::vector<PoseRow>& rows, const std::string& subject) {
  const std::size_t width = rows.front().values.size();
  if (width == 8) return PoseFormat::Tum;
  if (width == 12 || width == 13 || width == 16 || width == 17) return PoseFormat::Kitti;
  if (width == 7) return PoseFormat::Hba;
  if (width == 4 && rows.size() % 4 == 0) return PoseFormat::Balm;
  throw InputError("input.malformed", subject,
                   "line " + std::to_string(rows.front().line) + " has " + std::to_string(width) +
                       " numbers, which is not a known pose format",
                   kKnownFormats);
}

void readTum(const std::vector<PoseRow>& rows, PoseFile& file, PoseRowReader& reader) {
  requireWidth(rows, 8, file.subject);
  for (const PoseRow& row : rows) {
    const auto& v = row.values;
    reader.add(row.line, v[0], [&](PoseChecker& checker) {
      return checker.fromQuaternion({v[1], v[2], v[3]}, {v[7], v[4], v[5], v[6]}, row.line);
    });
  }
  file.stamped = true;
  file.notices.push_back("poses: TUM, sensor to world, quaternion order x y z w");
}

void readHba(const std::vector<PoseRow>& rows, PoseFile& file, PoseRowReader& reader) {
  requireWidth(rows, 7, file.subject);
  for (const PoseRow& row : rows) {
    const auto& v = row.values;
    reader.add(row.line, 0, [&](PoseChecker& checker) {
      return checker.fromQuaternion({v[0], v[1], v[2]}, {v[3], v[4], v[5], v[6]}, row.line);
    });
  }
  file.notices.push_back("poses: HBA/MLCC, sensor to world, quaternion order w x y z");
}

bool increase(std::initializer_list<std::size_t> columns) {
  return std::adjacent_find(columns.begin(), columns.end(), std::greater_equal<>()) == columns.end();
}

/// A format that was asked for must not contradict the names.
void requireFormat(PoseFormat format, const PoseTable& table, const std::string& subject) {
  const NamedColumns& names = *table.names;
  const auto& [x, y, z] = names.position;
  const auto& [qw, qx, qy, qz] = names.quaternion;
  const bool tum = names.hasTime() && !names.hasMatrix() && increase({names.time, x, y, z, qx, qy, qz, qw});
  const bool hba = !names.hasTime() && !names.hasMatrix() && increase({x, y, z, qw, qx, qy, qz});
  if (format == PoseFormat::Auto || (format == PoseFormat::Tum && tum) || (format == PoseFormat::Hba && hba) ||
      (format == PoseFormat::Kitti && names.hasMatrix()))
    return;
  throw InvalidArgument("usage.pose_format", subject,
                        "names its columns (" + table.names_text + "), which is not the format that was asked for",
                        "Omit pose_format, or remove the line of names if it is wrong");
}

/// A column of files' names counts before one of numbers. Where it has whole numbers, each once, those are the numbers
/// of the scans.
void takeNumbersFromNames(const NamedColumns& names, PoseFile& file) {
  constexpr std::uint64_t kMost = 1'000'000'000'000'000;  // as of a column of numbers: beyond are times
  std::vector<std::uint64_t> numbers;
  for (const std::string& name : file.scan_names) {
    std::uint64_t number = 0;
    if (!parseCount(name, number) || number >= kMost) return;
    numbers.push_back(number);
  }
  if (numbers.empty()) return;
  file.scan_names.clear();
  if (names.hasTime()) return;
  const bool different = std::set<std::uint64_t>(numbers.begin(), numbers.end()).size() == numbers.size();
  if (!different && file.numbered) return;
  file.numbered = true;
  file.numbers = std::move(numbers);
}

void readNamed(const PoseTable& table, PoseFile& file, PoseRowReader& reader) {
  const NamedColumns& names = *table.names;
  file.numbered = !names.hasTime() && names.index != NamedColumns::kNone;
  for (const PoseRow& row : table.rows) {
    const double* const v = row.values.data() + 2;
    const double number = row.values[1];
    if (!(number >= 0 && number < 1e15 && number == std::floor(number)))
      throw InputError("input.malformed", file.subject,
                       "line " + std::to_string(row.line) + " has a scan's number that is no whole number",
                       "Correct the column, or its name");
    if (file.numbered) file.numbers.push_back(static_cast<std::uint64_t>(number));
    reader.add(row.line, row.values[0], [&](PoseChecker& checker) {
      Eigen::Isometry3d pose =
          names.hasMatrix()
              ? checker.fromMatrix(Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>>(v), row.line)
              : checker.fromQuaternion({v[0], v[1], v[2]}, {v[3], v[4], v[5], v[6]}, row.line);
      pose.translation() *= names.position_unit_m;
      return pose;
    });
  }
  takeNumbersFromNames(names, file);
  if (file.numbered && file.scan_names.empty())
    for (PoseEntry& pose : file.poses) pose.index = file.numbers[pose.index];
  file.stamped = names.hasTime();
  std::string order;
  if (!names.hasMatrix()) {
    std::vector<std::pair<std::size_t, char>> columns;
    for (std::size_t i = 0; i < 4; ++i) columns.emplace_back(names.quaternion[i], "wxyz"[i]);
    std::sort(columns.begin(), columns.end());
    for (const auto& [column, axis] : columns) order += std::string(" ") + axis;
  }
  file.notices.push_back("poses: by their columns' names, sensor to world, " +
                         (order.empty() ? "matrices" : "quaternion order" + order));
}

void checkStamps(PoseFile& file, bool sort_poses) {
  auto& poses = file.poses;
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
    if (!isSamePose(poses[i].T_W_S, poses[i - 1].T_W_S))
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

/// Stamps become seconds.
void scaleStamps(PoseFile& file, const std::optional<double>& said_s) {
  std::vector<double> stamps;
  for (const PoseEntry& pose : file.poses) stamps.push_back(pose.stamp_s);
  const double unit_s = timeUnit_s(stamps, said_s, file.subject);
  if (unit_s == 1) return;
  for (PoseEntry& pose : file.poses) pose.stamp_s *= unit_s;
  file.notices.push_back(std::string("poses: times are in ") + timeUnitName(unit_s));
}

void requireDifferentNumbers(const PoseFile& file) {
  std::vector<std::pair<std::size_t, std::size_t>> numbers;
  for (const PoseEntry& pose : file.poses) numbers.emplace_back(pose.index, pose.line);
  std::sort(numbers.begin(), numbers.end());
  const auto twice = std::adjacent_find(numbers.begin(), numbers.end(),
                                        [](const auto& a, const auto& b) { return a.first == b.first; });
  if (twice != numbers.end())
    throw UnusableInput("poses.duplicate", file.subject,
                        "lines " + std::to_string(twice->second) + " and " + std::to_string((twice + 1)->second) +
                            " have the same scan's number",
                        "Remove one of them");
}

}  // namespace

void requireWidth(const std::vector<PoseRow>& rows, std::size_t width, const std::string& subject) {
  for (const PoseRow& row : rows)
    if (row.values.size() != width)
      throw InputError("input.malformed", subject,
                       "line " + std::to_string(row.line) + " has " + std::to_string(row.values.size()) +
                           " numbers, but this format needs " + std::to_string(width),
                       "Check the line and pose_format");
}

PoseFile readPoseFile(const std::filesystem::path& path, PoseFormat format, const std::filesystem::path& calib,
                      bool sort_poses) {
  PoseFile file;
  file.subject = forMessage(path.native());
  PoseTable table = readTable(path, file);
  if (!table.names) joinLines(table.rows, format, file);
  const std::vector<PoseRow>& rows = table.rows;
  PoseRowReader reader(file);
  if (table.names) {
    requireFormat(format, table, file.subject);
    file.format = table.names->hasMatrix() ? PoseFormat::Kitti
                  : table.names->hasTime() ? PoseFormat::Tum
                                           : PoseFormat::Hba;
    readNamed(table, file, reader);
  } else {
    file.format = format == PoseFormat::Auto ? formatOf(rows, file.subject) : format;
    switch (file.format) {
      case PoseFormat::Tum:
        readTum(rows, file, reader);
        break;
      case PoseFormat::Hba:
        readHba(rows, file, reader);
        break;
      case PoseFormat::Kitti:
        readMatrices(rows, file, reader);
        break;
      case PoseFormat::Balm:
        readBalm(rows, file, reader);
        break;
      case PoseFormat::Auto:
      case PoseFormat::Viewpoint:
        throw InvalidArgument("usage.pose_format", file.subject,
                              "a pose file and poses from VIEWPOINT exclude each other", "Omit one of the two");
    }
  }
  reader.finish();
  if (file.numbered && file.scan_names.empty()) requireDifferentNumbers(file);
  if (file.stamped) {
    scaleStamps(file, table.names ? table.names->time_unit_s : std::nullopt);
    checkStamps(file, sort_poses);
  }
  if (!calib.empty()) {
    if (file.format != PoseFormat::Kitti)
      throw InvalidArgument("usage.calib", file.subject,
                            "a calibration applies to KITTI poses, but these have another format",
                            "Omit ScanInputOptions::calib or use pose_format kitti");
    applyCalibration(calib, file);
  } else if (file.format == PoseFormat::Kitti) {
    const bool calib_near = isThere(path.parent_path() / "calib.txt");
    file.notices.push_back(
        std::string("poses: ") + (rows.front().values.size() == 12 ? "KITTI, 3x4 matrices" : "matrices") +
        ", taken as poses of the scanner itself, sensor to world" +
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
  const double unit_s = timeUnit_s(times, std::nullopt, subject);
  if (unit_s != 1)
    for (double& time : times) time *= unit_s;
  return times;
}

}  // namespace accessvdb::io
