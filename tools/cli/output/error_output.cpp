// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "output/error_output.h"

#include <algorithm>
#include <cctype>
#include <cstdio>
#include <filesystem>
#include <ios>
#include <new>
#include <nlohmann/json.hpp>
#include <string_view>
#include <system_error>
#include <utility>

#include "output/json_text.h"
#include "output/last_line.h"

namespace accessvdb::tools {
namespace {

constexpr std::size_t kMaxTextBytes = 1024;

void printLine(const std::string& line) { std::fprintf(stderr, "%s\n", line.c_str()); }

std::string jsonLine(const nlohmann::ordered_json& value) { return jsonText(value, -1); }

/// Names of the library's parameters and values, and the program's flags for them. Names that are ordinary words have
/// their struct before them.
constexpr std::pair<std::string_view, std::string_view> kFlagOf[] = {
    {"voxel_size_m", "--voxel"},
    {"range_noise_m", "--range-noise"},
    {"truncation_distance_m", "--tau"},
    {"min_range_m", "--min-range"},
    {"max_range_m", "--max-range"},
    {"num_directions", "--directions"},
    {"rolls", "--rolls"},
    {"ApproachParams::rolls", "--rolls"},
    {"ApproachParams::orientations", "--orientations"},
    {"corridor_length_m", "--corridor"},
    {"max_collisions", "--max-collisions"},
    {"neighbours", "--knn"},
    {"point_spacing_m", "--point-spacing"},
    {"score all points", "--points all"},
    {"points of the surface", "--points surface"},
    {"threads", "--threads"},
    {"device_cache_bytes", "--max-device-memory"},
    {"fuse_on_host", "--host-fusion"},
    {"origin_W", "--origin"},
    {"origins_W", "--sensor-at"},
    {"free_for_s", "--free-for"},
    {"clear_rays_m", "--clear-rays"},
    {"platform_radius_m", "--platform-radius"},
    {"spacing_m", "--spacing"},
    {"stand_off_m", "--stand-off"},
    {"within_m", "--within"},
    {"from_W", "--from"},
    {"ApproachOptions::each", "--each"},
    {"ViewOptions::body_radius_m", "--body"},
    {"ViewOptions::travel_m", "--travel"},
    {"ViewSensor::azimuth_rad", "--azimuth"},
    {"ViewSensor::elevation_min_rad", "--elevation"},
    {"ViewSensor::pitches_rad", "--pitches"},
    {"ViewSensor::rays", "--rays"},
    {"ViewSensor::max_range_m", "--reach"},
    {"FieldParams::carry", "--carry of map"},
    {"ToolForm::Voxels", "--profile product"},
    {"BackendKind::Cpu", "--device cpu"},
    {"ChangeMode::Off", "--change off"},
    {"ChangeMode::Block", "--change block"},
    {"ChangeMode::Full", "--change full"},
    {"RollingField", "--rolling"},
    {"UpdatePolicy::Exact", "--policy exact"},
    {"UpdatePolicy::Paper", "--policy paper"},
    {"LengthUnit", "--tool-unit"},
    {"ToolGeometry::fromMesh", "--tool"},
    {"ToolPose::tip", "--tool-tip"},
    {"ToolPose::axis", "--tool-axis"},
    {"ToolPose::up", "--tool-up"},
    {"Region::box", "--remove"},
    {"ScanInputOptions::scans", "--scans"},
    {"ScanInputOptions::poses", "--poses"},
    {"ScanInputOptions::calib", "--calib"},
    {"ScanInputOptions::every", "--every"},
    {"ScanInputOptions::trajectory", "--trajectory"},
    {"ScanInputOptions::stations", "--stations"},
    {"ScanInputOptions::topic", "--topic"},
    {"ScanInputOptions::level", "--level"},
    {"ScanInputOptions::deskew", "--deskew"},
    {"ScanInputOptions::match", "--match"},
    {"ScanInputOptions::max_gap_s", "--max-gap"},
    {"Match::Order", "--match order"},
    {"Match::Name", "--match name"},
    {"Match::Time", "--match time"},
    {"Level::from_imu", "--level imu"},
    {"Deskew::On", "--deskew on"},
    {"Deskew::Off", "--deskew off"},
    {"pose_format", "--pose-format"},
    {"sensor_at_W", "--sensor-at"},
    {"allow_truncated", "--allow-truncated"},
    {"allow_changed", "--allow-changed"},
    {"sort_poses", "--sort-poses"},
    {"time_offset_s", "--time-offset"},
    {"max_gap_s", "--max-gap"},
    {"laz_command", "--laz-command"},
    {"keep_noise", "--keep-noise"},
    {"crs_wkt", "--crs"},
    {"ScanInputOptions::index", "--index"},
    {"pose_topic", "--pose-topic"},
    {"fixed_frame", "--fixed-frame"},
    {"T_B_S", "--extrinsic"},
    {"exclude_box_S", "--exclude-box"},
    {"ray_W", "--ray"},
    {"view_W", "--view"},
    {"points_format", "--points-format"},
    {"process_limit_bytes", "--max-memory"},
    {"another folder for the output", "another --out folder"},
    {"a folder for the output", "an --out folder"},
    {"saveState()", "map --checkpoint"},
    {"tiles::run() of", "accessvdb tile run --tile"},
    {"tiles::removePlan", "--fresh"}};

bool isNamePart(char c) { return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_' || c == '-' || c == '/'; }

/// Whether a name ends before this text: what goes on is a longer name, or the name of a file.
bool endsBefore(std::string_view text) {
  if (text.empty()) return true;
  return !isNamePart(text[0]) && !text.starts_with("::") &&
         (text[0] != '.' || text.size() == 1 || !isNamePart(text[1]));
}

/// The text with the library's names replaced, where they are whole words.
/// @param is_name  all of it is a name; else "rolls", "threads" and "neighbours" are only words
std::string inFlags(std::string text, bool is_name) {
  for (const auto& [name, flag] : kFlagOf) {
    if (!is_name && std::all_of(name.begin(), name.end(), [](char c) { return c >= 'a' && c <= 'z'; })) continue;
    for (std::size_t at = 0; (at = text.find(name, at)) != std::string::npos;) {
      const bool begins = at == 0 || (!isNamePart(text[at - 1]) && text[at - 1] != ':');
      const bool whole = begins && endsBefore(std::string_view(text).substr(at + name.size()));
      if (whole) text.replace(at, name.size(), flag);
      at += whole ? flag.size() : name.size();
    }
  }
  return text;
}

/// Problems of states and plans are left as they are: they list parameters by the names that files have them by.
Failure inFlags(const Error& error) {
  const bool of_files = error.id().starts_with("state.") || error.id().starts_with("plan.");
  return {error.exitCode(), error.id(), inFlags(error.subject(), error.code() == ErrorCode::Usage),
          of_files ? error.problem() : inFlags(error.problem(), false), inFlags(error.advice(), false)};
}

std::string sentence(const std::string& text) { return text.empty() || text.back() == '.' ? text : text + "."; }

}  // namespace

std::string printable(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (out.size() >= kMaxTextBytes) return out + "...";
    const auto byte = static_cast<unsigned char>(c);
    if (byte >= 0x20 && byte != 0x7f) {
      out += c;
    } else {
      char escaped[8];
      std::snprintf(escaped, sizeof escaped, "\\x%02x", byte);
      out += escaped;
    }
  }
  return out;
}

Failure describeFailure(const std::exception& error) {
  if (const auto* ours = dynamic_cast<const Error*>(&error)) {
    return inFlags(*ours);
  }
  // std::thread and TBB say it in their own ways.
  const auto* system = dynamic_cast<const std::system_error*>(&error);
  if ((system != nullptr && system->code() == std::errc::resource_unavailable_try_again) ||
      std::string_view(error.what()).find("pthread_create") != std::string_view::npos) {
    return {static_cast<int>(ErrorCode::Resource), "limit.threads", "threads", "no more threads can be started",
            "Raise the limit on processes (ulimit -u, or that of the container), or end other programs"};
  }
  if (dynamic_cast<const std::bad_alloc*>(&error)) {
    return {OutOfMemory::kExitCode, OutOfMemory::kId, OutOfMemory::kSubject, OutOfMemory::kProblem,
            OutOfMemory::kAdvice};
  }
  // Of streams and of the file system: what can be foreseen is an Error that names the file.
  if (dynamic_cast<const std::ios_base::failure*>(&error)) {
    return {static_cast<int>(ErrorCode::Input), "input.unreadable", "",
            std::string("a file cannot be read (") + error.what() + ")", "Check the disk"};
  }
  if (const auto* file = dynamic_cast<const std::filesystem::filesystem_error*>(&error)) {
    if (file->code() == std::errc::too_many_files_open || file->code() == std::errc::too_many_files_open_in_system)
      return {static_cast<int>(ErrorCode::Resource), "limit.open_files", file->path1().string(), error.what(),
              "Raise the limit on open files (ulimit -n)"};
    return {static_cast<int>(ErrorCode::Output), "output.refused", file->path1().string(), error.what(),
            "Check the folder and the disk, then run again"};
  }
  return {static_cast<int>(ErrorCode::Internal), "internal.exception", "", error.what(),
          "This is a bug: please report it with this line and the command"};
}

void Messages::error(const Failure& failure) const {
  if (format_ == ErrorFormat::Json) {
    printLine(jsonLine({{"level", "error"},
                        {"id", failure.id},
                        {"exit_code", failure.exit_code},
                        {"subject", printable(failure.subject)},
                        {"problem", printable(failure.problem)},
                        {"advice", printable(failure.advice)}}));
    return;
  }
  std::string line = "accessvdb: error[" + failure.id + "] ";
  if (!failure.subject.empty()) line += printable(failure.subject) + ": ";
  line += sentence(printable(failure.problem));
  if (!failure.advice.empty()) line.append(" ").append(sentence(printable(failure.advice)));
  printLine(line);
}

void Messages::warning(const std::string& id, const std::string& of_library) {
  const std::string text = inFlags(of_library, false);
  warnings_.emplace_back(id, text);
  if (format_ == ErrorFormat::Json) {
    printLine(jsonLine({{"level", "warning"}, {"id", id}, {"text", printable(text)}}));
  } else {
    printLine("accessvdb: warning[" + id + "] " + sentence(printable(text)));
  }
}

void Messages::notice(const std::string& text) {
  notices_.push_back(inFlags(text, false));
  progress(text);
}

void Messages::progress(const std::string& of_library) const {
  if (quiet_) return;
  const std::string text = inFlags(of_library, false);
  if (format_ == ErrorFormat::Json) {
    printLine(jsonLine({{"level", "notice"}, {"text", printable(text)}}));
  } else {
    printLine("accessvdb: " + printable(text));
  }
}

}  // namespace accessvdb::tools
