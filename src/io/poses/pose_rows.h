// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Lines of numbers on their way to poses.
#pragma once

#include <cmath>
#include <exception>
#include <string>
#include <vector>

#include "accessvdb/error.h"
#include "io/poses/pose_checks.h"
#include "io/poses/pose_files.h"

namespace accessvdb::io {

/// One line of numbers.
struct PoseRow {
  std::vector<double> values;
  std::size_t line;
};

/// Adds poses to a file, and counts those that are none: zero or not finite.
class PoseRowReader {
 public:
  explicit PoseRowReader(PoseFile& file) : file_(file), checker_(file.subject) {}

  /// @param makePose  gives T_W_S by the checker, which throws for what is no pose
  template <typename MakePose>
  void add(std::size_t line, double stamp_s, const MakePose& makePose) {
    PoseEntry pose;
    pose.index = file_.written++;
    pose.line = line;
    pose.stamp_s = stamp_s;
    bool timed = false;
    try {
      if (!std::isfinite(stamp_s))
        throw UnusableInput("poses.non_finite", file_.subject,
                            "line " + std::to_string(line) + " has a time stamp that is not finite",
                            "Remove or correct that pose");
      timed = true;
      pose.T_W_S = makePose(checker_);
    } catch (const UnusableInput& error) {
      if (timed && !checker_.foundNone()) throw;  // something else was meant: another order, another format
      if (bad_++ == 0) {
        first_ = std::current_exception();
        first_problem_ = error.problem();
      }
      return;
    }
    file_.poses.push_back(pose);
  }
  /// @throws UnusableInput the first problem, if half of the poses are bad
  void finish() {
    if (2 * bad_ >= file_.written && first_) std::rethrow_exception(first_);
    checker_.addNotice(file_.notices);
    if (bad_ > 0)
      file_.warnings.push_back({"poses.skipped", file_.subject + ": " + std::to_string(bad_) + " of " +
                                                     std::to_string(file_.written) +
                                                     " poses are skipped: " + first_problem_});
  }

 private:
  PoseFile& file_;
  PoseChecker checker_;
  std::size_t bad_ = 0;
  std::exception_ptr first_;
  std::string first_problem_;
};

/// @throws InputError "input.malformed"
void requireWidth(const std::vector<PoseRow>& rows, std::size_t width, const std::string& subject);

/// KITTI's 3x4 matrices, 4x4 matrices of 16 numbers, and both with a time or a number first or last.
void readMatrices(const std::vector<PoseRow>& rows, PoseFile& file, PoseRowReader& reader);
/// Rows of 3x4 matrices in three lines of 4, and of Open3D's .log (a line "i i n", then four lines of 4), become one
/// row for each pose. @throws InputError "input.malformed": a .log of how pairs of scans lie to each other
void joinLines(std::vector<PoseRow>& rows, PoseFormat format, PoseFile& file);
/// BALM: 4 lines of 4.
void readBalm(const std::vector<PoseRow>& rows, PoseFile& file, PoseRowReader& reader);
/// Camera poses in the first camera frame become scanner poses in the first scanner frame. @throws InputError
void applyCalibration(const std::filesystem::path& path, PoseFile& file);

}  // namespace accessvdb::io
