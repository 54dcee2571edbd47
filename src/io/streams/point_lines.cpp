// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/streams/point_lines.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "accessvdb/error.h"
#include "io/streams/input_file.h"

namespace accessvdb::io {
namespace {

constexpr const char* kPointLineAdvice =
    "Write x y z first in each line, or name the columns in the first line, for example intensity,x,y,z";

std::string_view withoutQuotes(std::string_view token) {
  for (const char quote : {'"', '\''})
    if (token.size() >= 2 && token.front() == quote && token.back() == quote) token = token.substr(1, token.size() - 2);
  const std::size_t begin = std::min(token.find_first_not_of(" \t"), token.size());
  const std::size_t end = token.find_last_not_of(" \t");
  return end == std::string_view::npos ? std::string_view() : token.substr(begin, end + 1 - begin);
}

/// As splitTokens, but nothing between two commas or semicolons is a value, too: a missing one.
void splitCells(std::string_view line, std::vector<std::string_view>& cells) {
  cells.clear();
  bool filled = false;  // the place before the next comma
  for (std::size_t at = 0; at < line.size();) {
    const char c = line[at];
    if (c == ',' || c == ';') {
      if (!filled) cells.emplace_back();
      filled = false;
      ++at;
    } else if (c == ' ' || c == '\t' || c == '\r') {
      ++at;
    } else {
      std::size_t end = std::min(line.find_first_of(" \t,;\r", at), line.size());
      if (c == '"') end = std::min(line.find('"', at + 1), line.size() - 1) + 1;
      cells.push_back(withoutQuotes(line.substr(at, end - at)));
      filled = true;
      at = end;
    }
  }
}

/// What separates names that may have blanks: "Point ID;X;Y;Z". 0: nothing does.
char separatorOfNames(std::string_view line) {
  for (const char separator : {'\t', ';', ','})
    if (line.find(separator) != std::string_view::npos) return separator;
  return 0;
}

/// As splitCells, with names that have blanks. Several tabs are one: they line up columns. One at the beginning is
/// behind the name of an index, which has none.
void splitNames(std::string_view line, char separator, std::vector<std::string_view>& cells) {
  cells.clear();
  for (std::size_t begin = 0; begin < line.size();) {
    const std::size_t first = std::min(line.find_first_not_of(' ', begin), line.size());
    const std::size_t quote = first < line.size() && line[first] == '"' ? line.find('"', first + 1) : first;
    const std::size_t end = std::min(line.find(separator, std::min(quote, line.size())), line.size());
    const std::string_view cell = withoutQuotes(withoutQuotes(line.substr(first, end - first)));
    if (!cell.empty() || (end < line.size() && (separator != '\t' || begin == 0))) cells.push_back(cell);
    begin = end + 1;
  }
}

bool parseValue(std::string_view cell, double& value) {
  if (parseNumber(cell, value)) return true;
  if (cell.size() > 4) return false;
  const std::string word = inLowerCase(cell);
  constexpr std::string_view kMissing[] = {"", "null", "none", "na", "n/a", "#n/a", "nil"};
  value = std::numeric_limits<double>::quiet_NaN();
  return std::find(std::begin(kMissing), std::end(kMissing), word) != std::end(kMissing);
}

/// A column's name without its unit, in lower case, and the unit: "X [ft]" and "x_ft" become "x" and "ft".
std::pair<std::string, std::string> nameAndUnit(std::string_view cell) {
  const std::size_t bracket = std::min(cell.find_first_of("[("), cell.size());
  std::string name = inLowerCase(withoutQuotes(cell.substr(0, bracket)));
  std::string unit = inLowerCase(cell.substr(bracket));
  unit.erase(std::remove_if(unit.begin(), unit.end(),
                            [](char c) { return std::string_view("[]() \"").find(c) != std::string_view::npos; }),
             unit.end());
  const std::size_t line = name.find_last_of("_ ");
  if (line == std::string::npos || !unit.empty()) return {name, unit};
  constexpr std::string_view kColumnUnits[] = {"m",    "mm",   "cm", "km",   "ft", "usft",
                                               "ftus", "feet", "in", "inch", "deg"};
  const std::string end = name.substr(line + 1);
  if (std::find(std::begin(kColumnUnits), std::end(kColumnUnits), end) == std::end(kColumnUnits)) return {name, unit};
  return {name.substr(0, line), end};
}

struct ColumnName {
  std::string_view name;
  int meaning;  ///< 0 to 2: x y z; 3: geographic
};
constexpr ColumnName kColumnNames[] = {{"x", 0},
                                       {"y", 1},
                                       {"z", 2},
                                       {"px", 0},
                                       {"py", 1},
                                       {"pz", 2},
                                       {"pos_x", 0},
                                       {"pos_y", 1},
                                       {"pos_z", 2},
                                       {"posx", 0},
                                       {"posy", 1},
                                       {"posz", 2},
                                       {"point_x", 0},
                                       {"point_y", 1},
                                       {"point_z", 2},
                                       {"x_coord", 0},
                                       {"y_coord", 1},
                                       {"z_coord", 2},
                                       {"xcoord", 0},
                                       {"ycoord", 1},
                                       {"zcoord", 2},
                                       {"easting", 0},
                                       {"northing", 1},
                                       {"elevation", 2},
                                       {"elev", 2},
                                       {"east", 0},
                                       {"north", 1},
                                       {"height", 2},
                                       {"altitude", 2},
                                       {"coord_x", 0},
                                       {"coord_y", 1},
                                       {"coord_z", 2},
                                       {"e", 0},
                                       {"n", 1},
                                       {"h", 2},
                                       {"points_m_xyz:0", 0},
                                       {"points_m_xyz:1", 1},
                                       {"points_m_xyz:2", 2},
                                       {"points:0", 0},
                                       {"points:1", 1},
                                       {"points:2", 2},
                                       {"x_coordinate", 0},
                                       {"y_coordinate", 1},
                                       {"z_coordinate", 2},
                                       {"lat", 3},
                                       {"latitude", 3},
                                       {"lon", 3},
                                       {"long", 3},
                                       {"longitude", 3}};

bool isMetre(const std::string& unit) {
  return unit.empty() || unit == "m" || unit == "metre" || unit == "meter" || unit == "metres" || unit == "meters";
}

/// The text of a comment, or nothing for other lines.
std::optional<std::string_view> commentIn(std::string_view line) {
  const std::size_t first = line.find_first_not_of(" \t,;\r");
  if (first == std::string_view::npos) return std::string_view();
  line.remove_prefix(first);
  if (line[0] != '#' && line[0] != '%' && !line.starts_with("//")) return std::nullopt;
  return line.substr(std::min(line.find_first_not_of("#%/"), line.size()));
}

}  // namespace

std::optional<PointLines::Names> PointLines::namesIn(std::string_view line, bool comment) const {
  if (comment) line.remove_prefix(std::min(line.find_first_not_of(" \t"), line.size()));
  const char separator = separatorOfNames(line);
  if (separator != 0)
    if (auto names = namesIn(line, separator, comment)) return names;
  return namesIn(line, 0, comment);
}

std::optional<PointLines::Names> PointLines::namesIn(std::string_view line, char separator, bool comment) const {
  std::vector<std::string_view> cells;
  if (separator != 0) splitNames(line, separator, cells);
  if (separator == 0) splitCells(line, cells);
  Names names;
  names.text = line;
  names.line = lines_.number();
  names.comment = comment;
  std::array<std::size_t, 4> found = {};
  bool plain = false;         // x, y and z themselves: they are meant where there are others
  bool coordinate = false;    // the name before is of one
  std::string unit, bracket;  // what is in brackets behind a name, so far
  for (std::size_t i = 0; i < cells.size(); ++i) {
    if (!bracket.empty() || (!cells[i].empty() && (cells[i][0] == '(' || cells[i][0] == '['))) {  // "X (US ft)"
      bracket += cells[i];
      if (bracket.find_first_of(")]") == std::string::npos) continue;
      if (coordinate && !isMetre(nameAndUnit(bracket).second)) unit = nameAndUnit(bracket).second;
      bracket.clear();
      continue;
    }
    coordinate = false;
    const auto [name, name_unit] = nameAndUnit(cells[i]);
    const std::size_t column = names.columns++;
    const auto known = std::find_if(std::begin(kColumnNames), std::end(kColumnNames),
                                    [&, &word = name](const ColumnName& one) { return one.name == word; });
    if (known == std::end(kColumnNames)) continue;
    const auto meaning = static_cast<std::size_t>(known->meaning);
    const bool literal = name == "x" || name == "y" || name == "z";
    if (meaning < 3 && plain && !literal) continue;
    if (meaning < 3 && literal && !plain) {
      plain = true;
      found = {0, 0, 0, found[3]};
      unit.clear();
    }
    if (meaning == 3 && comment && column > 0 && found[3] == 0) continue;  // a sentence about them
    ++found[meaning];
    coordinate = meaning < 3;
    if (meaning < 3) names.xyz[meaning] = column;
    if (meaning < 3 && !isMetre(name_unit)) unit = name_unit;
  }
  if (found[3] >= 2 && (found[0] == 0 || found[1] == 0))
    throw InputError("input.geographic", lines_.subject(),
                     "line " + std::to_string(lines_.number()) + " names latitude and longitude",
                     "Export the points in a projection, in metres");
  if (found[0] != 1 || found[1] != 1 || found[2] != 1) return std::nullopt;
  if (!unit.empty())
    throw InputError("input.unit", lines_.subject(),
                     "line " + std::to_string(lines_.number()) + " names coordinates in '" + wordForMessage(unit) + "'",
                     "Export the points in metres");
  return names;
}

void PointLines::readHeading(std::string_view line) {
  const auto names = namesIn(line, false);
  if (!names || named())
    lines_.fail("is neither three numbers nor a line that names the columns x, y and z", kPointLineAdvice);
  names_ = names;
}

/// A comment that names other columns than there are is only a comment.
void PointLines::checkNames() {
  if (!names_) return;
  const bool first_three = names_->xyz == Columns{0, 1, 2};
  if (names_->columns == values_.size()) return;
  // Blanks may separate them, too: "R G B,X,Y,Z".
  if (const auto by_blanks = namesIn(names_->text, 0, names_->comment);
      by_blanks && by_blanks->columns == values_.size()) {
    names_->xyz = by_blanks->xyz;
    names_->columns = by_blanks->columns;
    return;
  }
  if (first_three) return;
  if (names_->comment) {
    names_.reset();
    return;
  }
  lines_.fail("has " + std::to_string(values_.size()) + " values where line " + std::to_string(names_->line) +
                  " names " + std::to_string(names_->columns) + " columns",
              kPointLineAdvice);
}

bool PointLines::readValues(Eigen::Vector3d& p) const {
  const Columns xyz = names_ ? names_->xyz : Columns{0, 1, 2};
  for (std::size_t axis = 0; axis < 3; ++axis)
    if (xyz[axis] >= values_.size() || !parseValue(values_[xyz[axis]], p[static_cast<Eigen::Index>(axis)]))
      return false;
  return true;
}

bool PointLines::next(Eigen::Vector3d& p) {
  std::string_view line;
  while (lines_.next(line)) {
    if (const auto comment = commentIn(line)) {
      if (points_ == 0 && !comment->empty() && (!names_ || names_->comment)) {
        if (const auto names = namesIn(*comment, true)) names_ = names;
      }
      continue;
    }
    lines_.refuseCommasInNumbers(line);
    splitCells(line, values_);
    std::uint64_t count = 0;
    if (values_.size() == 1 && points_ == announced_ && lines_.terminated() && parseCount(values_[0], count) &&
        count <= std::numeric_limits<std::uint32_t>::max()) {
      count_line_ = count_line_.value_or(lines_.number());
      announced_ += count;
      continue;
    }
    if (line.find('\r') != std::string_view::npos) lines_.failCarriageReturns();
    if (values_.size() < 3 && !lines_.terminated() && points_ != 0) {
      cut_off_ = true;
      return false;
    }
    double number = 0;
    const bool index_without_name = values_.size() > 1 && values_[0].empty() && !parseValue(values_[1], number);
    if (points_ == 0 && (index_without_name || !parseValue(values_[0], number))) {
      readHeading(line);
      continue;
    }
    if (points_ == 0) checkNames();
    if (!readValues(p)) lines_.fail("does not have three numbers for x y z", kPointLineAdvice);
    if (count_line_ && points_ == announced_)
      lines_.fail("is one more than the " + std::to_string(announced_) + " points that line " +
                      std::to_string(*count_line_) + " announces",
                  "Correct the count, or export the points again");
    ++points_;
    extent_.add(p, values_, names_ ? names_->xyz : Columns{0, 1, 2});
    return true;
  }
  return false;
}

void PointLines::seek(const Place& place) {
  lines_.seek(place.byte, static_cast<std::size_t>(place.line));
  points_ = place.points;
  extent_ = {};
  extent_.whole = points_ == 0;
  announced_ = place.announced;
  cut_off_ = false;
  if (points_ == 0 && announced_ == 0) {
    names_.reset();
    count_line_.reset();
  }
}

std::optional<std::uint64_t> PointLines::announced() const {
  return count_line_ ? std::optional(announced_) : std::nullopt;
}

void PointLines::Extent::add(const Eigen::Vector3d& p, const std::vector<std::string_view>& cells, const Columns& xyz) {
  if (p.isZero(0) || !p.allFinite()) return;  // no return
  low = low.cwiseMin(p);
  high = high.cwiseMax(p);
  constexpr int kLooked = 100;
  if (looked == kLooked) return;
  ++looked;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::string_view cell = cells[xyz[axis]];
    const std::size_t point = cell.find('.');
    if (point != std::string_view::npos) decimals[axis] = std::max(decimals[axis], cell.size() - point - 1);
  }
}

void PointLines::refuseDegrees() const {
  constexpr std::size_t kDecimals = 6;  // a step of 0.1 m
  constexpr double kWide_deg = 0.1, kHigh_m = 1;
  const Eigen::Vector3d most = extent_.high.cwiseMax(-extent_.low), size = extent_.high - extent_.low;
  const double wide = size.head<2>().maxCoeff();
  if (!extent_.whole || !(wide > 0) || wide > kWide_deg || !(size.z() >= kHigh_m)) return;
  if (most.head<2>().minCoeff() > 90 || most.head<2>().maxCoeff() > 180) return;
  const std::size_t decimals = std::min(extent_.decimals[0], extent_.decimals[1]);
  if (decimals < kDecimals) return;
  // Nothing that is scanned in metres is a thousand times as high as it is wide, or finer across than along z.
  const bool finer = decimals > kDecimals && decimals >= extent_.decimals[2] + 2 && size.z() > 100 * wide;
  if (size.z() <= 1000 * wide && !finer) return;
  throw InputError("input.geographic", lines_.subject(),
                   "does not say what its coordinates are, and they look like latitude and longitude in degrees",
                   "Export the points in a projection, in metres");
}

std::string PointLines::heading() const {
  std::string words;
  if (names_ && !(names_->comment && names_->xyz == Columns{0, 1, 2})) {
    words = "line " + std::to_string(names_->line) + " names the columns, x y z are";
    for (const std::size_t column : names_->xyz) words += " " + std::to_string(column + 1);
  }
  if (count_line_)
    words +=
        std::string(words.empty() ? "" : "; ") + "line " + std::to_string(*count_line_) + " has the number of points";
  return words;
}

}  // namespace accessvdb::io
