// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/poses/column_names.h"

#include <algorithm>
#include <map>
#include <utility>

#include "io/streams/text_lines.h"

namespace accessvdb::io {
namespace {

constexpr std::size_t kNone = NamedColumns::kNone;

bool isDigit(char c) { return c >= '0' && c <= '9'; }
bool isLetter(char c) { return c >= 'a' && c <= 'z'; }

template <typename... Words>
bool isOneOf(std::string_view word, Words... words) {
  return ((word == words) || ...);
}

std::optional<double> secondsOf(std::string_view unit) {
  if (isOneOf(unit, "s", "sec", "secs", "second", "seconds")) return 1;
  if (isOneOf(unit, "ms", "msec", "msecs", "millis", "millisecond", "milliseconds")) return 1e-3;
  if (isOneOf(unit, "us", "usec", "usecs", "micros", "microsec", "microsecond", "microseconds", "\xc2\xb5s",
              "\xce\xbcs"))
    return 1e-6;
  if (isOneOf(unit, "ns", "nsec", "nsecs", "nanos", "nanosec", "nanosecs", "nanosecond", "nanoseconds")) return 1e-9;
  return std::nullopt;
}

/// Feet are of several lengths: 0 for them.
std::optional<double> metresOf(std::string_view unit) {
  if (isOneOf(unit, "m", "meter", "meters", "metre", "metres")) return 1;
  if (isOneOf(unit, "mm")) return 1e-3;
  if (isOneOf(unit, "cm")) return 1e-2;
  if (isOneOf(unit, "km")) return 1e3;
  if (isOneOf(unit, "ft", "feet", "foot", "ftus", "usft")) return 0;
  return std::nullopt;
}

/// A column's name in lower-case words, and its unit: "p_RS_R_x [m]" is {"p", "rs", "r", "x"} and "m".
struct Name {
  std::vector<std::string> words;
  std::string unit;

  [[nodiscard]] bool has(std::string_view word) const {
    return std::find(words.begin(), words.end(), word) != words.end();
  }
  template <typename... Words>
  [[nodiscard]] bool hasAny(Words... any) const {
    return (has(any) || ...);
  }
};

Name nameOf(std::string_view cell) {
  Name name;
  std::string text;
  for (const char c : cell) text += c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  if (const std::size_t open = text.find_first_of("[("); open != std::string::npos) {
    const std::size_t close = text.find_first_of("])", open);
    name.unit = text.substr(open + 1, close == std::string::npos ? close : close - open - 1);
    while (!name.unit.empty() && name.unit.back() == ' ') name.unit.pop_back();
    text.resize(open);
  }
  std::string word;
  for (const char c : text + " ") {
    if (isLetter(c) || isDigit(c) || (c & 0x80) != 0) {
      word += c;
    } else if (!word.empty()) {
      name.words.push_back(std::exchange(word, {}));
    }
  }
  // m_0_0 and m_00 are m00.
  const auto isNumber = [](const std::string& digit) { return std::all_of(digit.begin(), digit.end(), isDigit); };
  std::string digits;
  while (name.words.size() > 1 && digits.size() < 2 && isNumber(name.words.back()) &&
         digits.size() + name.words.back().size() <= 2) {
    digits.insert(0, name.words.back());
    name.words.pop_back();
  }
  if (!digits.empty()) name.words.back() += digits;
  // A unit may be the last word: stamp_ns, x_mm. A single word is the name.
  if (name.unit.empty() && name.words.size() > 1 && (secondsOf(name.words.back()) || metresOf(name.words.back()))) {
    name.unit = name.words.back();
    name.words.pop_back();
  }
  return name;
}

enum class Meaning { Other, Time, Position, HeightAlias, Quaternion, Matrix, Vector, Latitude, Longitude, Index, File };

struct Role {
  Meaning meaning = Meaning::Other;
  std::size_t place = 0;  ///< of Position and Vector 0 .. 2 (3), of Quaternion 0 .. 3, of Matrix 10 * row + column
};

/// x y z w after a prefix: "tx", "qw"; or alone, when other words say what it is.
Role axisRole(const Name& name) {
  const std::string& last = name.words.back();
  const std::string_view axes = "wxyz";
  const std::size_t axis = axes.find(last.back());
  if (axis == std::string_view::npos) return {};
  const std::string_view prefix = std::string_view(last).substr(0, last.size() - 1);
  const bool quaternion =
      isOneOf(prefix, "q", "quat", "quaternion", "rot", "rotation", "ori", "orientation", "o") ||
      (prefix.empty() &&
       (name.hasAny("q", "quat", "quaternion", "rot", "rotation", "ori", "orientation") || axis == 0));
  if (quaternion) return {Meaning::Quaternion, axis};
  const bool position = prefix.empty() || isOneOf(prefix, "t", "p", "pos", "position", "trans", "translation", "loc",
                                                  "location", "utm", "local");
  if (position && axis > 0) return {Meaning::Position, axis - 1};
  return {};
}

Role numberedRole(const std::string& word) {
  std::size_t digits = word.size();
  while (digits > 0 && isDigit(word[digits - 1])) --digits;
  const std::string_view prefix = std::string_view(word).substr(0, digits),
                         number = std::string_view(word).substr(digits);
  if (number.size() == 2 && isOneOf(prefix, "m", "r", "t", "mat", "rot", "tf", "pose", "matrix"))
    return {Meaning::Matrix, static_cast<std::size_t>(10 * (number[0] - '0') + number[1] - '0')};
  if (number.size() != 1) return {};
  const auto digit = static_cast<std::size_t>(number[0] - '0');
  if (isOneOf(prefix, "q") && digit <= 3) return {Meaning::Quaternion, digit};
  if (isOneOf(prefix, "t", "p") && digit <= 3) return {Meaning::Vector, digit};
  return {};
}

Role roleOf(const Name& name) {
  if (name.words.empty()) return {};
  // Of motion and of uncertainty, not of the pose: EuRoC's v_RS_R_x and b_w_RS_S_x, odometry's twist.
  if (name.hasAny("v", "vel", "velocity", "twist", "linear", "angular", "acc", "accel", "acceleration", "gyro", "omega",
                  "bias", "b", "cov", "covariance", "std", "stddev", "sigma", "var", "variance", "gravity", "mag",
                  "force", "week"))
    return {};
  const std::string& last = name.words.back();
  if (const Role role = axisRole(name); role.meaning != Meaning::Other) return role;
  if (const Role role = numberedRole(last); role.meaning != Meaning::Other) return role;
  if (isOneOf(last, "qr")) return {Meaning::Quaternion, 0};
  if (isOneOf(last, "qi")) return {Meaning::Quaternion, 1};
  if (isOneOf(last, "qj")) return {Meaning::Quaternion, 2};
  if (isOneOf(last, "qk")) return {Meaning::Quaternion, 3};
  if (isOneOf(last, "easting", "east", "e")) return {Meaning::Position, 0};
  if (isOneOf(last, "northing", "north", "n")) return {Meaning::Position, 1};
  if (isOneOf(last, "height", "h", "elevation", "altitude", "alt", "up")) return {Meaning::HeightAlias, 2};
  if (isOneOf(last, "lat", "latitude")) return {Meaning::Latitude};
  if (isOneOf(last, "lon", "long", "longitude", "lng")) return {Meaning::Longitude};
  if (name.hasAny("t", "time", "timestamp", "timestamps", "stamp", "stamps", "gpstime", "epoch", "unixtime", "rostime",
                  "tow", "utc") ||
      (name.words.size() == 1 && secondsOf(last)))
    return {Meaning::Time};
  if (name.has("frame") && name.has("id")) return {};  // the name of a frame of coordinates
  if (name.hasAny("file", "filename", "name", "path", "cloud", "pcd", "station", "scan")) return {Meaning::File};
  if (name.hasAny("num", "id", "idx", "index", "seq", "frame", "number", "no", "nr", "keyframe", "kf"))
    return {Meaning::Index};
  return {};
}

std::vector<std::string_view> namesIn(std::string_view line) {
  std::vector<std::string_view> cells = strictCells(line);
  if (!cells.empty()) {
    if (cells.back().empty()) cells.pop_back();
    return cells;
  }
  std::vector<std::string_view> tokens;
  splitTokens(line, tokens);
  for (const std::string_view token : tokens) {
    const bool unit = token.front() == '[' || token.front() == '(' ||
                      (!cells.empty() && cells.back().find_first_of("[(") != std::string_view::npos &&
                       cells.back().find_first_of("])") == std::string_view::npos);
    if (unit && !cells.empty()) {
      const char* const begin = cells.back().data();
      cells.back() = {begin, static_cast<std::size_t>(token.data() + token.size() - begin)};
    } else {
      cells.push_back(token);
    }
  }
  return cells;
}

struct TimeColumn {
  std::size_t column;
  std::optional<double> unit_s;
  bool stamp;  ///< of the message, which counts before the time of its recording
};

void chooseTime(std::vector<TimeColumn> times, NamedColumns& names) {
  if (std::any_of(times.begin(), times.end(), [](const TimeColumn& time) { return time.stamp; }))
    std::erase_if(times, [](const TimeColumn& time) { return !time.stamp; });
  if (times.size() == 2 && times[1].unit_s == 1 && times[0].unit_s == 1e-9) std::swap(times[0], times[1]);
  if (times.size() == 2 && times[1].unit_s == 1e-9 && times[0].unit_s.value_or(1) == 1) {
    names.time = times[0].column;
    names.nanoseconds = times[1].column;
    names.time_unit_s = 1;
    return;
  }
  if (times.size() > 1) names.conflict = "time";
  if (times.empty()) return;
  names.time = times.front().column;
  names.time_unit_s = times.front().unit_s;
}

/// Rows and columns count from 0 if any number has a 0, else from 1; the fourth column may be x y z or t1 t2 t3.
void arrangeMatrix(const std::map<std::size_t, std::size_t>& elements, const std::map<std::size_t, std::size_t>& vector,
                   NamedColumns& names) {
  if (elements.size() < 9) return;
  const auto base = [](const std::map<std::size_t, std::size_t>& numbers, bool pairs) -> std::size_t {
    for (const auto& [number, column] : numbers)
      if (number % 10 == 0 || (pairs && number / 10 == 0)) return 0;
    return 1;
  };
  const std::size_t first = base(elements, true), vector_first = base(vector, false);
  for (std::size_t row = 0; row < 3; ++row) {
    for (std::size_t column = 0; column < 4; ++column) {
      const auto found = elements.find(10 * (row + first) + column + first);
      if (found != elements.end()) names.matrix[4 * row + column] = found->second;
    }
    if (names.matrix[4 * row + 3] == kNone) names.matrix[4 * row + 3] = names.position[row];
    const auto of_vector = vector.find(row + vector_first);
    if (names.matrix[4 * row + 3] == kNone && of_vector != vector.end()) names.matrix[4 * row + 3] = of_vector->second;
  }
}

}  // namespace

std::size_t NamedColumns::last(bool pose) const {
  std::size_t most = 0;
  const auto take = [&](std::size_t column) {
    if (column != kNone) most = std::max(most, column);
  };
  take(time);
  take(nanoseconds);
  if (!pose || !hasMatrix()) std::for_each(position.begin(), position.end(), take);
  if (pose && hasMatrix()) std::for_each(matrix.begin(), matrix.end(), take);
  if (pose && !hasMatrix()) std::for_each(quaternion.begin(), quaternion.end(), take);
  return most;
}

void NamedColumns::moveLeft(std::size_t places) {
  const auto move = [places](std::size_t& column) {
    if (column != kNone) column -= places;
  };
  for (std::size_t* column : {&file, &index, &time, &nanoseconds}) {
    if (*column != kNone && *column < places) *column = kNone;
    move(*column);
  }
  std::for_each(position.begin(), position.end(), move);
  std::for_each(quaternion.begin(), quaternion.end(), move);
  std::for_each(matrix.begin(), matrix.end(), move);
  count -= places;
}

std::optional<NamedColumns> parseColumnNames(std::string_view line) {
  if (const std::size_t begin = line.find_first_not_of("#%/ \t"); begin != std::string_view::npos)
    line.remove_prefix(begin);
  NamedColumns names;
  std::vector<TimeColumn> times;
  std::map<std::size_t, std::size_t> elements, vector;
  std::size_t height = kNone, latitude = kNone, longitude = kNone;
  const auto take = [&](std::size_t& role, std::size_t column, const std::string& what) {
    if (role != kNone && names.conflict.empty()) names.conflict = what;
    role = column;
  };
  const std::vector<std::string_view> cells = namesIn(line);
  names.count = cells.size();
  for (std::size_t column = 0; column < cells.size(); ++column) {
    const Name name = nameOf(cells[column]);
    const Role role = roleOf(name);
    if (role.meaning == Meaning::Other) continue;
    if (names.known++ == 0) names.first_known = column;
    switch (role.meaning) {
      case Meaning::Time:
        times.push_back({column, secondsOf(name.unit.empty() ? name.words.back() : name.unit),
                         name.hasAny("stamp", "timestamp", "stamps", "timestamps")});
        break;
      case Meaning::Position:
        take(names.position[role.place], column, std::string(1, "xyz"[role.place]));
        if (const auto unit_m = metresOf(name.unit)) {
          if (*unit_m == 0) names.conflict = "feet";
          names.position_unit_m = *unit_m;
        }
        break;
      case Meaning::HeightAlias:
        if (height == kNone) height = column;
        break;
      case Meaning::Quaternion:
        take(names.quaternion[role.place], column, std::string("q") + "wxyz"[role.place]);
        break;
      case Meaning::Matrix:
        elements[role.place] = column;
        break;
      case Meaning::Vector:
        vector[role.place] = column;
        break;
      case Meaning::Latitude:
        latitude = column;
        break;
      case Meaning::Longitude:
        longitude = column;
        break;
      case Meaning::Index:
        if (names.index == kNone) names.index = column;
        break;
      case Meaning::File:
        if (names.file == kNone) names.file = column;
        break;
      case Meaning::Other:
        break;
    }
  }
  chooseTime(std::move(times), names);
  if (names.position[2] == kNone) names.position[2] = height;
  arrangeMatrix(elements, vector, names);
  names.geographic = latitude != kNone && longitude != kNone && !names.hasPosition() && !names.hasMatrix();
  if (!names.geographic && !names.hasMatrix() && names.position[0] == kNone) return std::nullopt;
  return names;
}

std::vector<std::string_view> strictCells(std::string_view line) {
  std::vector<std::string_view> cells;
  for (const char separator : {';', ',', '\t'}) {
    if (line.find(separator) == std::string_view::npos) continue;
    for (std::size_t begin = 0; begin <= line.size();) {
      const std::size_t end = std::min(line.find(separator, begin), line.size());
      std::string_view cell = line.substr(begin, end - begin);
      const std::size_t first = cell.find_first_not_of(" \t\r\"");
      cell = first == std::string_view::npos ? std::string_view()
                                             : cell.substr(first, cell.find_last_not_of(" \t\r\"") - first + 1);
      cells.push_back(cell);
      begin = end + 1;
    }
    break;
  }
  return cells;
}

}  // namespace accessvdb::io
