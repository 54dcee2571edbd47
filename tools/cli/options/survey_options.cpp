// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "options/survey_options.h"

#include <algorithm>
#include <array>
#include <charconv>

#include "accessvdb/error.h"
#include "options/options.h"
#include "options/tools_given.h"
#include "output/error_output.h"

namespace accessvdb::tools {
namespace {

constexpr std::array<std::pair<const char*, io::Match>, 4> kMatches = {
    {{"auto", io::Match::Auto}, {"order", io::Match::Order}, {"name", io::Match::Name}, {"time", io::Match::Time}}};

}  // namespace

void addSurveyOptions(FlagParser& flags, SurveyOptions& options) {
  flags.option(
      "--trajectory", &options.trajectory,
      "positions of the sensor over time (t x y z, TUM, or CSV with a header), for .las, .laz or .ply in the world "
      "frame with a time per return");
  flags.option("--time-offset", &options.time_offset_s,
               "seconds added to the times of clouds or scans before the trajectory or the poses are looked up");
  addGapOption(flags, options);
  flags.option("--match", &options.match,
               "how poses are matched to scans: auto, order, name (numbers in names are those of poses) or time");
  flags.option("--stations", &options.stations,
               "scanner positions, one line 'file x y z' for each cloud in the world frame");
  flags.option("--ray", &options.ray,
               "X,Y,Z from the sensor to every point of a cloud in the world frame whose rays are not known, metres: "
               "0,0,-10 for a flight above it");
  flags.flag("--keep-noise", options.keep_noise,
             "keep the points of LAS and LAZ that are withheld, synthetic or of the noise classes 7 and 18");
  flags.option(
      "--laz-command", &options.laz_command,
      "command that writes a LAZ file, its last argument, as LAS to standard output; default: laszip -stdout or "
      "las2las -stdout, if installed");
}

void addCarryOption(FlagParser& flags, SurveyOptions& options) {
  flags.repeated("--carry", &options.carry,
                 "an attribute of the scans that the points get, such as classification or tree_id: what most of a "
                 "point's returns have, of several the lowest; NAME=COLUMN gives its column another name");
  flags.flag(
      "--index", options.index,
      "columns scan and index: the number of the scan and of the row in it of each point's first return, from 0");
  flags.option(
      "--crs", &options.crs,
      "coordinate system of the scans, in place of what LAS files say: a code such as EPSG:32632 (needs proj-bin) "
      "or a file with well-known text; points.las says it");
}

std::vector<CarriedName> carriedNames(const SurveyOptions& options) {
  std::vector<CarriedName> names;
  if (options.carry.empty()) return names;
  for (const std::string& text : valuesOf(options.carry)) {
    const std::size_t equals = text.find('=');
    names.push_back({text.substr(0, equals), equals == std::string::npos ? text : text.substr(equals + 1)});
  }
  return names;
}

void addGapOption(FlagParser& flags, SurveyOptions& options) {
  flags.option("--max-gap", &options.max_gap_s,
               "longest time without poses, in seconds, over which they are interpolated, 0.001 .. 10");
}

void applySurveyOptions(const SurveyOptions& options, io::ScanInputOptions& input) {
  input.trajectory = options.trajectory;
  input.time_offset_s = options.time_offset_s;
  input.max_gap_s = options.max_gap_s;
  const auto match =
      std::find_if(kMatches.begin(), kMatches.end(), [&](const auto& one) { return options.match == one.first; });
  if (match == kMatches.end())
    throw InvalidArgument("usage.word", "--match", "\"" + printable(options.match) + "\" is not known",
                          "Use one of auto, order, name, time");
  input.match = match->second;
  input.stations = options.stations;
  input.laz_command = options.laz_command;
  input.keep_noise = options.keep_noise;
  if (!options.ray.empty()) input.ray_W = parseVector("--ray", options.ray);
  for (const CarriedName& name : carriedNames(options)) input.carry.push_back(name.in_scans);
  input.index = options.index;
  if (!options.crs.empty()) input.crs_wkt = io::crsWkt(options.crs);
}

std::vector<std::pair<std::string, std::string>> givenSurveyOptions(const SurveyOptions& options) {
  std::vector<std::pair<std::string, std::string>> given;
  if (!options.trajectory.empty()) {
    given.emplace_back("trajectory", options.trajectory);
  }
  if (!options.trajectory.empty() || options.time_offset_s != 0) {
    // All digits: GPS time has ten before the point.
    std::array<char, 32> text;
    const auto end = std::to_chars(text.data(), text.data() + text.size(), options.time_offset_s).ptr;
    given.emplace_back("time_offset", std::string(text.data(), end));
  }
  if (options.max_gap_s != SurveyOptions().max_gap_s) given.emplace_back("max_gap", numberText(options.max_gap_s));
  if (options.match != SurveyOptions().match) given.emplace_back("match", options.match);
  if (!options.stations.empty()) given.emplace_back("stations", options.stations);
  if (!options.ray.empty()) given.emplace_back("ray", options.ray);
  if (options.keep_noise) given.emplace_back("keep_noise", "true");
  if (!options.laz_command.empty()) given.emplace_back("laz_command", options.laz_command);
  if (!options.carry.empty()) given.emplace_back("carried", valuesInWords(options.carry));
  if (options.index) given.emplace_back("index", "true");
  if (!options.crs.empty()) given.emplace_back("crs", options.crs);
  return given;
}

}  // namespace accessvdb::tools
