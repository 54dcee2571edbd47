// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/poses/trajectory.h"

#include <algorithm>
#include <cmath>

#include "accessvdb/error.h"
#include "io/clouds/point_times.h"
#include "io/poses/column_reader.h"
#include "io/poses/pose_matching.h"
#include "io/streams/byte_source.h"
#include "io/streams/input_file.h"
#include "io/streams/text_lines.h"

namespace accessvdb::io {
namespace {

constexpr ColumnReader::Wanted kTrajectoryColumns = {.id = "trajectory",
                                                     .what = "A trajectory has a time and a position in each line",
                                                     .names = "time x y z",
                                                     .time = true,
                                                     .counted = true};

struct TimedRow {
  Trajectory::Node node;
  std::size_t line = 0;
};

TimedRow parseRow(const ColumnReader& reader, const std::string& subject) {
  static const NamedColumns kPlain = [] {
    NamedColumns columns;
    columns.time = 0;
    columns.position = {1, 2, 3};
    return columns;
  }();
  const NamedColumns& columns = reader.names() ? *reader.names() : kPlain;
  TimedRow row;
  row.line = reader.line();
  row.node.stamp_s = reader.number(columns.time);
  if (columns.nanoseconds != NamedColumns::kNone) row.node.stamp_s += 1e-9 * reader.number(columns.nanoseconds);
  for (std::size_t axis = 0; axis < 3; ++axis)
    row.node.p_W[static_cast<Eigen::Index>(axis)] = reader.number(columns.position[axis]) * columns.position_unit_m;
  if (!std::isfinite(row.node.stamp_s) || !row.node.p_W.allFinite())
    throw UnusableInput("trajectory.non_finite", subject,
                        "line " + std::to_string(row.line) + " has a time or position that is not finite",
                        "Remove or correct that line");
  return row;
}

/// Sorts if that is allowed, and drops what is written twice.
std::vector<Trajectory::Node> checkedNodes(std::vector<TimedRow>& rows, const std::string& subject, bool sort,
                                           std::vector<std::string>& notices) {
  const auto earlier = [](const TimedRow& a, const TimedRow& b) { return a.node.stamp_s < b.node.stamp_s; };
  const auto reversed =
      std::adjacent_find(rows.begin(), rows.end(), [&](const TimedRow& a, const TimedRow& b) { return earlier(b, a); });
  if (reversed != rows.end()) {
    if (!sort)
      throw UnusableInput("trajectory.reversed", subject,
                          "line " + std::to_string((reversed + 1)->line) + " is earlier than the position before it",
                          "Use sort_poses to sort them by time");
    std::stable_sort(rows.begin(), rows.end(), earlier);
    notices.push_back("trajectory: sorted by time");
  }
  std::vector<Trajectory::Node> nodes;
  nodes.reserve(rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const bool again = i > 0 && rows[i].node.stamp_s == rows[i - 1].node.stamp_s;
    if (again && rows[i].node.p_W != rows[i - 1].node.p_W)
      throw UnusableInput("trajectory.duplicate", subject,
                          "lines " + std::to_string(rows[i - 1].line) + " and " + std::to_string(rows[i].line) +
                              " have the same time and different positions",
                          "Remove one of them, or write the times with more digits");
    if (!again) nodes.push_back(rows[i].node);
  }
  if (nodes.size() < rows.size())
    notices.push_back("trajectory: " + std::to_string(rows.size() - nodes.size()) + " repeated positions were dropped");
  return nodes;
}

}  // namespace

Trajectory Trajectory::read(const std::filesystem::path& path, bool sort, double max_gap_s) {
  const std::string subject = forMessage(path.native());
  const std::unique_ptr<ByteSource> source = openFile(path);
  LineReader lines(*source, 0, subject);
  ColumnReader reader(lines, kTrajectoryColumns);
  std::vector<TimedRow> rows;
  while (reader.next()) rows.push_back(parseRow(reader, subject));
  source->checkAtEnd();
  if (rows.empty())
    throw UnusableInput("trajectory.none", subject, "contains no positions", "Use the trajectory of this survey");
  std::vector<std::string> notices = reader.notices();
  std::vector<double> times;
  for (const TimedRow& row : rows) times.push_back(row.node.stamp_s);
  const std::optional<NamedColumns>& names = reader.names();
  if (const double unit_s = timeUnit_s(times, names ? names->time_unit_s : std::nullopt, subject); unit_s != 1) {
    for (TimedRow& row : rows) row.node.stamp_s *= unit_s;
    notices.push_back(std::string("trajectory: times are in ") + timeUnitName(unit_s));
  }
  std::vector<Node> nodes = checkedNodes(rows, subject, sort, notices);
  Trajectory trajectory(std::move(nodes), subject, max_gap_s);
  std::string where = "the first four columns";
  if (names) {
    where = "columns " + std::to_string(names->time + 1);
    for (const std::size_t column : names->position) where += " " + std::to_string(column + 1);
  }
  notices.insert(notices.begin(),
                 "trajectory: time x y z from " + where + ", the sensor's positions in the cloud's frame");
  trajectory.notices_ = std::move(notices);
  return trajectory;
}

std::optional<double> Trajectory::gapAt_s(double stamp_s) const {
  const auto after = std::upper_bound(nodes_.begin(), nodes_.end(), stamp_s,
                                      [](double stamp, const Node& node) { return stamp < node.stamp_s; });
  if (after == nodes_.begin() || after == nodes_.end()) return std::nullopt;
  return after->stamp_s - (after - 1)->stamp_s;
}

std::optional<Eigen::Vector3d> Trajectory::at(double stamp_s, std::size_t& near) const {
  // `near` becomes the first node that is not before the stamp.
  const auto fits = [&](std::size_t i) {
    return i <= nodes_.size() && (i == nodes_.size() || stamp_s <= nodes_[i].stamp_s) &&
           (i == 0 || nodes_[i - 1].stamp_s < stamp_s);
  };
  if (std::isnan(stamp_s)) return std::nullopt;
  if (!fits(near) && !fits(++near)) {
    const auto after = std::lower_bound(nodes_.begin(), nodes_.end(), stamp_s,
                                        [](const Node& node, double stamp) { return node.stamp_s < stamp; });
    near = static_cast<std::size_t>(after - nodes_.begin());
  }
  const Node* const after = near < nodes_.size() ? &nodes_[near] : nullptr;
  const Node* const before = near > 0 ? &nodes_[near - 1] : nullptr;
  if (after != nullptr && before != nullptr && bridges(after->stamp_s - before->stamp_s, max_gap_s_)) {
    const double share = (stamp_s - before->stamp_s) / (after->stamp_s - before->stamp_s);
    return Eigen::Vector3d((1 - share) * before->p_W + share * after->p_W);
  }
  if (after != nullptr && after->stamp_s - stamp_s <= kSameStamp_s) return after->p_W;
  if (before != nullptr && stamp_s - before->stamp_s <= kSameStamp_s) return before->p_W;
  return std::nullopt;
}

}  // namespace accessvdb::io
