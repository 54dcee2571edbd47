// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/poses/trajectory.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "accessvdb/error.h"
#include "io/poses/pose_matching.h"
#include "io/streams/byte_source.h"
#include "io/streams/input_file.h"
#include "io/streams/text_lines.h"

namespace accessvdb::io {
namespace {

using Columns = std::array<std::size_t, 4>;  ///< of time, x, y, z
constexpr Columns kPlainColumns = {0, 1, 2, 3};

/// A column's name without unit and quotes, in lower case: "GPSTime[s]" becomes "gpstime".
std::string plainName(std::string_view token) {
  token = token.substr(0, token.find_first_of("[("));
  std::string name;
  for (const char c : token)
    if (c != '"' && c != '%' && c != '#') name += c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return name;
}

bool isOneOf(const std::string& name, std::initializer_list<const char*> names) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

/// 0 time, 1 to 3 x y z, 4 geographic, nothing for other columns.
std::optional<std::size_t> meaningOf(const std::string& name) {
  if (isOneOf(name, {"t", "time", "time_s", "timestamp", "stamp", "gps_time", "gpstime", "sec", "seconds"})) return 0;
  if (isOneOf(name, {"x", "tx", "px", "x_m", "pos_x", "easting", "east", "e"})) return 1;
  if (isOneOf(name, {"y", "ty", "py", "y_m", "pos_y", "northing", "north", "n"})) return 2;
  if (isOneOf(name, {"z", "tz", "pz", "z_m", "pos_z", "height", "h", "elevation", "altitude", "alt", "up"})) return 3;
  if (isOneOf(name, {"lat", "latitude", "lon", "long", "longitude"})) return 4;
  return std::nullopt;
}

/// The columns that a line names, if it names each of time, x, y and z exactly once.
std::optional<Columns> namedColumns(const std::vector<std::string_view>& tokens, const LineReader& lines) {
  std::array<std::size_t, 5> count = {};
  Columns columns = {};
  std::size_t column = 0;
  for (const std::string_view token : tokens) {
    const std::string name = plainName(token);
    if (name.empty()) continue;  // the sign of a comment that stands alone
    if (const auto meaning = meaningOf(name)) {
      ++count[*meaning];
      if (*meaning < columns.size()) columns[*meaning] = column;
    }
    ++column;
  }
  if (count[4] == 2 && count[0] == 1)
    throw UnusableInput("trajectory.geographic", lines.subject(),
                        "line " + std::to_string(lines.number()) + " names latitude and longitude",
                        "Export the trajectory in the projection of the cloud, in metres");
  if (count[0] != 1 || count[1] != 1 || count[2] != 1 || count[3] != 1) return std::nullopt;
  return columns;
}

struct TimedRow {
  Trajectory::Node node;
  std::size_t line = 0;
};

TimedRow parseRow(const std::vector<std::string_view>& tokens, const Columns& columns, const LineReader& lines) {
  TimedRow row;
  row.line = lines.number();
  std::array<double, 4> value = {};
  for (std::size_t i = 0; i < columns.size(); ++i) {
    if (columns[i] >= tokens.size())
      lines.fail("has " + std::to_string(tokens.size()) + " columns, too few for time x y z",
                 "A trajectory has a time and a position in each line");
    if (!parseNumber(tokens[columns[i]], value[i]))
      lines.fail("has '" + wordForMessage(tokens[columns[i]]) + "' where a number is needed",
                 "A trajectory has a time and a position in each line");
    if (!std::isfinite(value[i]))
      throw UnusableInput("trajectory.non_finite", lines.subject(),
                          "line " + std::to_string(lines.number()) + " has a time or position that is not finite",
                          "Remove or correct that line");
  }
  row.node = {value[0], {value[1], value[2], value[3]}};
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

Trajectory Trajectory::read(const std::filesystem::path& path, bool sort) {
  const std::string subject = forMessage(path.native());
  const std::unique_ptr<ByteSource> source = openFile(path);
  LineReader lines(*source, 0, subject);
  std::string_view line;
  std::vector<std::string_view> tokens;
  std::vector<TimedRow> rows;
  std::optional<Columns> named;
  while (lines.next(line)) {
    splitTokens(line, tokens);
    if (tokens.empty()) continue;
    double number = 0;
    if (isBlankOrComment(line) || (rows.empty() && !parseNumber(tokens.front(), number))) {
      const bool comment = isBlankOrComment(line) || tokens.front().front() == '%';
      const auto columns = rows.empty() ? namedColumns(tokens, lines) : std::nullopt;
      if (columns) named = columns;
      if (!columns && !comment)
        lines.fail("is neither a time and a position nor a header that names time, x, y and z",
                   "A trajectory has a time and a position in each line");
      continue;
    }
    rows.push_back(parseRow(tokens, named.value_or(kPlainColumns), lines));
  }
  source->checkAtEnd();
  if (rows.empty())
    throw UnusableInput("trajectory.none", subject, "contains no positions", "Use the trajectory of this survey");
  std::vector<std::string> notices;
  std::vector<Node> nodes = checkedNodes(rows, subject, sort, notices);
  Trajectory trajectory(std::move(nodes), subject);
  std::string where = "the first four columns";
  if (named) {
    where = "columns";
    for (const std::size_t column : *named) where += " " + std::to_string(column + 1);
  }
  notices.insert(notices.begin(),
                 "trajectory: time x y z from " + where + ", the sensor's positions in the cloud's frame");
  trajectory.notices_ = std::move(notices);
  return trajectory;
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
  if (after != nullptr && before != nullptr && after->stamp_s - before->stamp_s <= kMaxPoseGap_s) {
    const double share = (stamp_s - before->stamp_s) / (after->stamp_s - before->stamp_s);
    return Eigen::Vector3d((1 - share) * before->p_W + share * after->p_W);
  }
  if (after != nullptr && after->stamp_s - stamp_s <= kSameStamp_s) return after->p_W;
  if (before != nullptr && stamp_s - before->stamp_s <= kSameStamp_s) return before->p_W;
  return std::nullopt;
}

}  // namespace accessvdb::io
