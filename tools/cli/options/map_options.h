// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The flags of `map` and what they mean to the library.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "accessvdb/params.h"
#include "accessvdb/scan_io.h"
#include "options/command_line.h"
#include "options/export_options.h"
#include "options/options.h"
#include "options/recording_options.h"
#include "options/sensor_options.h"
#include "options/survey_options.h"

namespace accessvdb::tools {

struct MapOptions {
  CommonOptions common;
  ToolOptions tool;
  PictureOptions picture;
  ExportOptions exported;
  SurveyOptions survey;
  RecordingOptions recording;
  SensorOptions sensor;
  std::string scans, poses, out, calib, sensor_at, tau, max_memory;
  std::string checkpoint, checkpoint_every = "5m", resume;
  std::string pose_format = "auto", profile = "product", policy, orientations, change, free_for;
  std::string points = "all", point_spacing = "auto", clear_rays;
  std::string margins;                           ///< of all tools
  std::string tool_name, rolls, max_collisions;  ///< of several tools of each, see tools_given.h
  double voxel_m = 0.01;
  std::optional<double> min_range_m, max_range_m, range_noise_m, corridor_m, platform_radius_m;
  std::optional<int> directions, knn;
  int every = 1, update_every = 0;
  std::string tiles = "auto", bin_memory, origin, rolling, replay_log;
  bool keep_rays = false, fresh = false, html = false;
  bool allow_truncated = false, allow_disagreement = false, sort_poses = false, no_clobber = false,
       print_config = false, mirror_distance = false;
  bool host_fusion = false;
  std::string max_device_memory;
  bool still = false;  ///< --static
  bool allow_open_tool = false, allow_hidden_tool = false;
  std::vector<std::string> remove;
  std::string removed_as = "unknown";
  bool forgetful = false;  ///< live: --change full --free-for 60 unless something else is said
};

void addMapOptions(FlagParser& flags, MapOptions& options);
/// All of them without description and common flags. @param out  "--out", or "OUT" for its place on the command line
void addMapFlags(FlagParser& flags, MapOptions& options, const std::string& out);

/// Adds the flags that say where scans and poses are.
void addScanFlags(FlagParser& flags, MapOptions& options);
/// Adds the flags for the tool and the map, for every verb that keeps a field.
void addFieldOptions(FlagParser& flags, MapOptions& options);

/// Adds the flags for reading and mapping scans, for every verb that maps scans.
void addMappingOptions(FlagParser& flags, MapOptions& options);

/// Adds the flags for space that is known to be free, for every verb that keeps a field.
void addClearOptions(FlagParser& flags, MapOptions& options);

/// Adds the flags for a world that changes, for every verb that keeps a field.
void addChangeOptions(FlagParser& flags, MapOptions& options);
/// What is likely not meant, as a warning.
void sayChangeNotes(const FieldParams& params, Messages& messages);

/// Adds the flags for the tool's orientations, for every verb that keeps a field.
void addOrientationOptions(FlagParser& flags, MapOptions& options);
/// How many orientations of a list were given twice, as a notice.
void sayOrientationNotes(const MapOptions& options, Messages& messages);

/// Adds the flags for which points are scored, for every verb that keeps a field.
void addPointsOptions(FlagParser& flags, MapOptions& options);
/// What they say: FieldParams::scoring.point_spacing_m. @throws InvalidArgument
[[nodiscard]] double pointSpacing_m(const std::string& points, const std::string& spacing, const TsdfParams& tsdf);

/// Adds the flag for the mirror of distances, for every verb that keeps a field.
void addMirrorOption(FlagParser& flags, MapOptions& options);

/// Adds the flags for where scans are fused on a GPU, for every verb that takes scans and --device.
void addFusionOptions(FlagParser& flags, MapOptions& options);

/// Checks what the flags alone determine. @throws InvalidArgument, DeviceError
void checkMapOptions(const MapOptions& options);

/// Edge of a tile that --tiles gives, metres; 0 for auto and off. @throws InvalidArgument "usage.tiles"
[[nodiscard]] double wantedTile_m(const MapOptions& options);

/// World position of the local frame that --origin gives, rounded to whole voxels; nothing without the flag.
/// @throws InvalidArgument; InputError for a folder without an earlier result
[[nodiscard]] std::optional<std::array<double, 3>> givenOrigin(const MapOptions& options);

/// @throws InvalidArgument
[[nodiscard]] io::ScanInputOptions scanInputOptions(const MapOptions& options);

/// Resolved parameters. Range noise: the flag, else what was recorded next to the scans, else the library's default.
/// @throws InvalidArgument
[[nodiscard]] FieldParams fieldParams(const MapOptions& options, std::optional<double> recorded_noise_m = {});

/// Prints the effective configuration as TOML, and what follows from it as comments.
/// @param verb  with the program's name  @param reserve  what may change that
void printConfig(const FlagParser& flags, const MapOptions& options, const std::string& verb,
                 const std::string& reserve = {});

}  // namespace accessvdb::tools
