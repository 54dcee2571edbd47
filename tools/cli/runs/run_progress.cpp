// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "runs/run_progress.h"

#include <algorithm>
#include <charconv>

#include "accessvdb/error.h"
#include "runs/progress_json.h"

namespace accessvdb::tools {
namespace {

using Json = nlohmann::ordered_json;

Json jsonOf(const std::vector<io::InputFile>& files) {
  Json list = Json::array();
  for (const io::InputFile& file : files) list.push_back({{"path", file.path}, {"sha256", file.sha256}});
  return list;
}
std::vector<io::InputFile> filesFrom(const Json& list) {
  std::vector<io::InputFile> files;
  for (const Json& file : list) files.push_back({file.at("path"), file.at("sha256")});
  return files;
}

}  // namespace

std::string fullNumber(double value) {
  char text[40];
  return {text, std::to_chars(text, text + sizeof text, value).ptr};
}

Reading readingOf(const MapOptions& options) {
  Reading reading = {{"every", std::to_string(options.every)},
                     {"pose_format", options.pose_format},
                     {"sensor_at", options.sensor_at},
                     {"time_offset", fullNumber(options.survey.time_offset_s)},
                     {"allow_truncated", options.allow_truncated ? "true" : "false"},
                     {"sort_poses", options.sort_poses ? "true" : "false"}};
  // Later than the first checkpoints, which do not have them.
  for (const auto& given : givenRecordingOptions(options.recording)) reading.insert(given);
  for (const auto& given : givenSensorOptions(options.sensor))
    if (given.first != "deskew") reading.insert(given);  // what it does counts: Checkpoints::readAs
  for (const auto& given : givenSurveyOptions(options.survey)) {
    const std::set<std::string> of_reading = {"ray", "match", "max_gap", "carried", "index", "crs"};
    if (of_reading.contains(given.first)) reading.insert(given);
  }
  if (options.survey.keep_noise) reading["keep_noise"] = "true";
  return reading;
}

RunProgress RunProgress::startOfTheseScans() const {
  RunProgress start;
  start.earlier_scans = earlier_scans;
  start.earlier = earlier;
  return start;
}

RunProgress RunProgress::followedByOthers() const {
  RunProgress start;
  start.earlier_scans = scansFused();
  start.earlier = earlier;
  start.earlier.insert(start.earlier.end(), poses.begin(), poses.end());
  start.earlier.insert(start.earlier.end(), scans.begin(), scans.end());
  return start;
}

void addProgress(const RunProgress& progress, const Reading& reading, Json& to) {
  to["earlier_scans"] = progress.earlier_scans;
  to["earlier"] = jsonOf(progress.earlier);
  to["next_step"] = progress.next_step;
  to["steps"] = progress.steps;
  to["points_in"] = progress.points_in;
  to["points_used"] = progress.points_used;
  to["dropped"] = progress.dropped;
  to["frames"] = progress.frames;
  to["reading"] = reading;
  to["poses"] = jsonOf(progress.poses);
  to["scans"] = jsonOf(progress.scans);
}

RunProgress progressFrom(const Json& json) {
  RunProgress progress;
  progress.earlier_scans = json.at("earlier_scans");
  progress.earlier = filesFrom(json.at("earlier"));
  progress.next_step = json.at("next_step");
  progress.steps = json.at("steps");
  progress.points_in = json.at("points_in");
  progress.points_used = json.at("points_used");
  progress.dropped = json.at("dropped");
  progress.frames = json.at("frames");
  progress.poses = filesFrom(json.at("poses"));
  progress.scans = filesFrom(json.at("scans"));
  return progress;
}

Reading readingFrom(const Json& json) { return json.at("reading").get<Reading>(); }

void requireSameReading(const ResumedProgress& before, Reading now, std::uint64_t steps) {
  for (const auto& [key, value] : before.reading) now.try_emplace(key, "");
  for (const auto& [key, value] : now) {
    const auto was = before.reading.find(key);
    if (was != before.reading.end() && was->second == value) continue;
    if (key == kSystem) continue;  // follows from the files, and was not always noted
    refuseToResume(
        "state.params", before.folder,
        key + " was \"" + (was == before.reading.end() ? "" : was->second) + "\" and is now \"" + value + "\"");
  }
  if (steps != before.progress.steps) {
    refuseToResume(
        "state.scans", before.folder,
        "there are now " + std::to_string(steps) + " scans to fuse, and were " + std::to_string(before.progress.steps));
  }
}

void requireSameInputs(const ResumedProgress& before, const RunProgress& now) {
  const auto compare = [&](const std::string& what, const auto& files_before, const auto& files) {
    for (std::size_t n = 0; n < std::min(files_before.size(), files.size()); ++n) {
      if (files_before[n].sha256 == files[n].sha256) continue;
      refuseToResume("state.scans", before.folder,
                     what + " " + files[n].path + " has different content from " + files_before[n].path);
    }
    if (files_before.size() == files.size()) return;
    refuseToResume("state.scans", before.folder,
                   "there are " + std::to_string(files.size()) + " files with " + what + "s now, and " +
                       std::to_string(files_before.size()) + " were read before");
  };
  compare("pose", before.progress.poses, now.poses);
  compare("scan", before.progress.scans, now.scans);
}

void refuseToResume(const std::string& id, const std::string& folder, const std::string& problem) {
  throw UnusableInput(id, folder, problem, "Repeat the run as it was, or start again without --resume");
}

}  // namespace accessvdb::tools
