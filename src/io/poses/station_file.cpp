// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/poses/station_file.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <system_error>

#include "accessvdb/error.h"
#include "accessvdb/program/path_facts.h"
#include "io/poses/column_names.h"
#include "io/streams/byte_source.h"
#include "io/streams/input_file.h"
#include "io/streams/text_lines.h"

namespace accessvdb::io {
namespace {

constexpr const char* kLineAdvice = "Write one line 'file x y z' for each scan";

struct StationLine {
  std::string name;
  Eigen::Vector3d p_W = Eigen::Vector3d::Zero();
};

StationLine checkedStation(StationLine station, const LineReader& lines) {
  if (station.name.empty()) lines.fail("has an empty name", kLineAdvice);
  if (!station.p_W.allFinite())
    throw UnusableInput("stations.non_finite", lines.subject(),
                        "line " + std::to_string(lines.number()) + " has a position that is not finite",
                        "Correct or remove that line");
  return station;
}

/// The name is what stands before the last three words, without quotes.
StationLine parseStation(std::string_view line, const std::vector<std::string_view>& tokens, const LineReader& lines) {
  StationLine station;
  bool good = tokens.size() >= 4;
  for (std::size_t axis = 0; good && axis < 3; ++axis)
    good = parseNumber(tokens[tokens.size() - 3 + axis], station.p_W[static_cast<Eigen::Index>(axis)]);
  if (!good) lines.fail("is not the name of a file and its x y z", kLineAdvice);
  const char* const begin = tokens.front().data();
  const std::string_view& last = tokens[tokens.size() - 4];
  std::string_view name = line.substr(static_cast<std::size_t>(begin - line.data()),
                                      static_cast<std::size_t>(last.data() + last.size() - begin));
  if (name.size() >= 2 && name.front() == '"' && name.back() == '"') name = name.substr(1, name.size() - 2);
  station.name = name;
  return checkedStation(std::move(station), lines);
}

/// Whether the lines are `file x y z`, as they are without a line of names.
bool isUsual(const NamedColumns& names) {
  const auto& [x, y, z] = names.position;
  return names.file < x && y == x + 1 && z == x + 2 && names.count == z + 1 && names.position_unit_m == 1;
}

StationLine namedStation(std::string_view line, const NamedColumns& names, const LineReader& lines) {
  std::vector<std::string_view> cells = strictCells(line);
  if (cells.empty()) splitTokens(line, cells);
  const bool complete = cells.size() > names.file && cells.size() > names.last(false);
  if (!complete || !names.conflict.empty() || (names.count != cells.size() && cells.back() != ""))
    lines.fail("does not have the columns that the line of names has", kLineAdvice);
  StationLine station;
  station.name = cells[names.file];
  for (std::size_t axis = 0; axis < 3; ++axis) {
    double& value = station.p_W[static_cast<Eigen::Index>(axis)];
    if (!parseNumber(cells[names.position[axis]], value)) lines.fail("has a position that is no number", kLineAdvice);
    value *= names.position_unit_m;
  }
  return checkedStation(std::move(station), lines);
}

std::vector<StationLine> parseStations(const std::filesystem::path& path, const std::string& subject) {
  const std::unique_ptr<ByteSource> source = openFile(path);
  LineReader lines(*source, 0, subject);
  std::string_view line;
  std::vector<std::string_view> tokens;
  std::vector<StationLine> stations;
  std::set<std::filesystem::path> seen;
  std::optional<NamedColumns> names;  // where they are in another order
  while (lines.next(line)) {
    const bool comment = isBlankOrComment(line);
    splitTokens(line, tokens);
    if (tokens.empty()) continue;
    double number = 0;
    const auto isNumber = [&](std::string_view token) { return parseNumber(token, number); };
    if (stations.empty() && (comment || std::none_of(tokens.begin(), tokens.end(), isNumber))) {
      const auto found = parseColumnNames(line);
      const bool complete = found && found->hasPosition() && found->file != NamedColumns::kNone;
      if (complete) names = isUsual(*found) ? std::nullopt : found;
      if (!complete && !comment) lines.fail("is not the name of a file and its x y z, nor names them", kLineAdvice);
      continue;
    }
    if (comment) continue;
    stations.push_back(names ? namedStation(line, *names, lines) : parseStation(line, tokens, lines));
    if (!seen.insert(std::filesystem::path(stations.back().name).lexically_normal()).second)
      throw UnusableInput(
          "stations.duplicate", subject,
          "line " + std::to_string(lines.number()) + " names " + wordForMessage(stations.back().name) + " again",
          "A scan has one position: remove one of the lines");
  }
  source->checkAtEnd();
  if (stations.empty()) throw UnusableInput("stations.none", subject, "contains no stations", kLineAdvice);
  return stations;
}

}  // namespace

StationList readStations(const std::filesystem::path& scans, const std::filesystem::path& stations) {
  const bool whole_folder = isFolder(scans);
  const std::string subject = forMessage(stations.native());
  StationList list;
  for (const StationLine& station : parseStations(stations, subject)) {
    const std::filesystem::path file = (whole_folder ? scans : scans.parent_path()) / station.name;
    if (!whole_folder && file.lexically_normal() != scans.lexically_normal()) continue;
    const ScanFileList one = listScanFile(file);
    if (list.scans.files.empty()) {
      list.scans = one;
    } else if (one.kind != list.scans.kind) {
      throw UnusableInput("stations.kinds", subject,
                          "names files of different kinds: " + forMessage(list.scans.files.front().native()) + ", " +
                              forMessage(file.native()),
                          "Convert them to one format");
    } else {
      list.scans.files.push_back(file);
    }
    list.positions_W.push_back(station.p_W);
  }
  if (list.scans.files.empty())
    throw UnusableInput(
        "stations.missing", subject, "has no line for " + forMessage(scans.native()),
        "Write one line 'file x y z' for each scan; names are relative to the folder of ScanInputOptions::scans");
  if (!whole_folder) return list;
  list.scans.folder = scans;
  list.scans.whole_folder = true;
  std::set<std::filesystem::path> named;
  for (const std::filesystem::path& file : list.scans.files) named.insert(file.lexically_normal());
  std::size_t unnamed = 0;
  for (const std::filesystem::path& file : scanFilesIn(scans, list.scans.kind))
    unnamed += named.count(file.lexically_normal()) == 0 ? 1 : 0;
  if (unnamed != 0)
    list.scans.notices.push_back("stations: " + std::to_string(unnamed) +
                                 " scans in the folder are not used: " + subject + " has no line for them");
  return list;
}

}  // namespace accessvdb::io
