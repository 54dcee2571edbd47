// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/poses/station_file.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <system_error>

#include "accessvdb/error.h"
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
  if (name.empty()) lines.fail("has an empty name", kLineAdvice);
  if (!station.p_W.allFinite())
    throw UnusableInput("stations.non_finite", lines.subject(),
                        "line " + std::to_string(lines.number()) + " has a position that is not finite",
                        "Correct or remove that line");
  station.name = name;
  return station;
}

std::vector<StationLine> parseStations(const std::filesystem::path& path, const std::string& subject) {
  const std::unique_ptr<ByteSource> source = openFile(path);
  LineReader lines(*source, 0, subject);
  std::string_view line;
  std::vector<std::string_view> tokens;
  std::vector<StationLine> stations;
  std::set<std::filesystem::path> seen;
  bool first = true;
  while (lines.next(line)) {
    if (isBlankOrComment(line)) continue;
    splitTokens(line, tokens);
    const bool header = first && tokens.size() == 4 && (tokens[1] == "x" || tokens[1] == "X");
    first = false;
    if (header) continue;
    stations.push_back(parseStation(line, tokens, lines));
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
  std::error_code error;
  const bool whole_folder = std::filesystem::is_directory(scans, error);
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
