// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "options/map_options.h"

#include <array>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <limits>
#include <sstream>
#include <tuple>
#include <utility>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/params_rows.h"
#include "accessvdb/program/path_facts.h"
#include "accessvdb/tiles.h"
#include "options/region_options.h"
#include "options/tools_given.h"
#include "runs/checkpoint.h"

namespace accessvdb::tools {
namespace {

template <typename Value, std::size_t kCount>
Value chooseWord(const std::string& flag, const std::string& word,
                 const std::array<std::pair<const char*, Value>, kCount>& words) {
  std::string list;
  for (const auto& [name, value] : words) {
    if (word == name) return value;
    list += (list.empty() ? "" : ", ") + std::string(name);
  }
  throw InvalidArgument("usage.word", flag, "\"" + word + "\" is not known", "Use one of " + list);
}

/// The same for a parameter that is one of several words.
template <typename Enum>
Enum chooseWord(const std::string& flag, const std::string& word) {
  std::array<std::pair<const char*, Enum>, kEnumWords<Enum>.size()> words;
  for (std::size_t n = 0; n < words.size(); ++n) words[n] = {kEnumWords<Enum>[n], static_cast<Enum>(n)};
  return chooseWord(flag, word, words);
}

constexpr std::array<std::pair<const char*, io::PoseFormat>, 6> kPoseFormats = {
    {{"auto", io::PoseFormat::Auto},
     {"tum", io::PoseFormat::Tum},
     {"kitti", io::PoseFormat::Kitti},
     {"balm", io::PoseFormat::Balm},
     {"hba", io::PoseFormat::Hba},
     {"viewpoint", io::PoseFormat::Viewpoint}}};
constexpr std::array<std::pair<const char*, Profile>, 2> kProfiles = {
    {{"product", Profile::Product}, {"paper", Profile::Paper}}};
/// What live forgets after, and what is hardly ever meant: at 12 m a Mid-360 confirms a voxel of 10 mm every 3 s.
constexpr double kFreeForLive_s = 60, kShortFreeFor_s = 10;

}  // namespace

void addFieldOptions(FlagParser& flags, MapOptions& options) {
  addToolsOptions(flags, options);
  addDoubtfulToolOptions(flags, options);
  flags.option("--voxel", &options.voxel_m, "edge of a voxel in metres");
  flags.option("--min-range", &options.min_range_m, "drop returns nearer than this, metres");
  flags.option("--max-range", &options.max_range_m, "drop returns beyond this, metres");
  flags.option("--range-noise", &options.range_noise_m,
               "sigma of the sensor's range noise, metres; default: recorded next to the scans, else 0.02");
  flags.option("--tau", &options.tau, "truncation distance in metres, or in voxels (4v)");
  flags.option("--profile", &options.profile, "product or paper");
  addOrientationOptions(flags, options);
  flags.option("--knn", &options.knn, "neighbours of a normal; default by rule");
  addPointsOptions(flags, options);
  addChangeOptions(flags, options);
  addClearOptions(flags, options);
  addFusionOptions(flags, options);
}

void addMappingOptions(FlagParser& flags, MapOptions& options) {
  flags.option("--pose-format", &options.pose_format, "auto, tum, kitti, balm, hba or viewpoint");
  flags.option("--calib", &options.calib, "KITTI calib.txt, if the poses are the camera's");
  addFieldOptions(flags, options);
  flags.option("--every", &options.every, "use every n-th scan");
  flags.flag("--allow-truncated", options.allow_truncated, "keep the complete records of truncated files");
  flags.flag("--allow-disagreement", options.allow_disagreement, "map scans that do not agree with each other");
  flags.flag("--sort-poses", options.sort_poses, "accept poses whose stamps run backwards, by sorting them");
  addSurveyOptions(flags, options.survey);
  addRecordingOptions(flags, options.recording);
  addSensorOptions(flags, options.sensor);
  addMotionOptions(flags, options.sensor);
}

void addOrientationOptions(FlagParser& flags, MapOptions& options) {
  flags.option("--directions", &options.directions, "yaw directions over 360 degrees, 4 .. 256");
  flags.repeated("--orientations", &options.orientations,
                 "how the tool can be turned, in degrees: yaw (the default), pitch:MIN:MAX:STEP, sphere:STEP, "
                 "sphere:STEP+yaw or list:FILE; at most 4096 together");
  flags.repeated("--rolls", &options.rolls,
                 "how many rolls about its body the tool may take in each orientation, 1 .. 64; default: 1, and for a "
                 "sphere 12 over a whole turn, fewer for a symmetric tool");
}

void sayOrientationNotes(const MapOptions& options, Messages& messages) {
  constexpr std::string_view kList = "list:";
  if (!options.orientations.starts_with(kList)) return;
  int twins = 0;
  static_cast<void>(OrientationSet::read(options.orientations.substr(kList.size()), &twins));
  if (twins == 0) return;
  messages.notice("orientations: " + std::to_string(twins) + (twins == 1 ? " is" : " are") +
                  " in the list already and left out");
}

void addPointsOptions(FlagParser& flags, MapOptions& options) {
  flags.option(
      "--points", &options.points,
      "which surface points are scored: all, or surface: one where the surface is, not those that noise has put "
      "beside it (reason beside_surface); not with --change full or the paper's profile");
  flags.option(
      "--point-spacing", &options.point_spacing,
      "with --points surface, edge of the cells of which one point each is scored, metres; auto = the voxel or "
      "--range-noise, whichever is larger");
}

double pointSpacing_m(const std::string& points, const std::string& spacing, const TsdfParams& tsdf) {
  if (points != "all" && points != "surface") {
    throw InvalidArgument("usage.word", "--points", "\"" + printable(points) + "\" is not known", "Use all or surface");
  }
  const bool is_auto = spacing == "auto";
  double spacing_m = std::max(tsdf.voxel_size_m, tsdf.range_noise_m);  // where these are of no use, others say so
  const char* end = spacing.data() + spacing.size();
  const auto [rest, error] =
      is_auto ? std::from_chars_result{end, std::errc()} : std::from_chars(spacing.data(), end, spacing_m);
  if (!is_auto && (error != std::errc() || rest != end || !(spacing_m > 0) || !std::isfinite(spacing_m))) {
    throw InvalidArgument("usage.point_spacing", "--point-spacing",
                          "\"" + printable(spacing) + "\" is not a positive length in metres",
                          "Use for example 0.02, or auto");
  }
  if (points == "surface") return spacing_m;
  if (!is_auto) {
    throw InvalidArgument("usage.point_spacing", "--point-spacing", "is only for --points surface",
                          "Add --points surface, or omit it");
  }
  return 0;
}

void addMirrorOption(FlagParser& flags, MapOptions& options) {
  flags.flag("--mirror-distance", options.mirror_distance,
             "also keep a live mirror of the distances, for your own kernels; no result depends on it");
}

void addFusionOptions(FlagParser& flags, MapOptions& options) {
  flags.flag(
      "--host-fusion", options.host_fusion,
      "on a GPU, fuse each scan on the processor before it is scored, as without one: the same labels, later. That "
      "is so anyway with --change full and where else docs/drone.md, On a GPU, says, among them tiles");
  flags.option("--max-device-memory", &options.max_device_memory,
               "on a GPU that fuses the scans, limit on the memory for the values of the map, for example 2G or 500M; "
               "what it holds no more it gets from the host again. Points and mirror come on top. Default: 4 GB for "
               "voxels down to 10 mm, 20 down to 5 mm, 64 below; never more than half of what is free at the start");
}

void addMapOptions(FlagParser& flags, MapOptions& options) {
  flags.describe(
      "map", "Scans + poses + tool -> accessibility field.",
      "accessvdb map --scans scans/ --poses poses.txt --tool pruner.stl --tool-unit mm --voxel 0.02 --out out/\n"
      "  accessvdb map --scans cloud.ply --sensor-at 0,0,1.5 --tool builtin:pencil --out out/\n"
      "  accessvdb map --scans walk.las --trajectory walk.txt --tool builtin:pruner --voxel 0.05 --out out/\n"
      "  accessvdb map --scans flight.mcap --topic /cloud_registered --tool builtin:pruner --voxel 0.05 --out out/");
  addCommonOptions(flags, options.common);
  addMapFlags(flags, options, "--out");
  flags.option("--checkpoint", &options.checkpoint,
               "folder in which the run leaves what --resume needs, should it be stopped or killed");
  flags.option("--checkpoint-every", &options.checkpoint_every,
               "time between checkpoints, for example 30s, 5m or 1h; 0 = only when stopped and after the last scan");
  flags.option("--resume", &options.resume, "go on from the checkpoint in this folder, and leave new ones there");
  flags.option("--rolling", &options.rolling,
               "folder for tiles that the sensor has left: they go there past --max-memory, and come back with it, so "
               "that a flight of any length fits; --resume with the same folder goes on after its last checkpoint");
  flags.option("--replay-log", &options.replay_log,
               "a --scan-log of live: take its scans, and score as many points after each as it did, for the same "
               "labels");
  flags.list(
      "--remove", options.remove,
      std::string("what has gone since: taken out of the map after the last scan; may be repeated: ") + kRegionForms);
  flags.option("--removed-as", &options.removed_as,
               "what is known of that place now: unknown (blocks until a scan sees through it) or free");
  flags.flag("--html", options.html, "also write report.html: the result as one page for a browser");
  flags.flag("--print-config", options.print_config, "print the effective configuration as TOML and exit");
}

void addClearOptions(FlagParser& flags, MapOptions& options) {
  flags.option("--clear-rays", &options.clear_rays,
               "how far from their returns rays clear the space that they went through, metres, or all; thin things "
               "between rays are not seen. Default: only before surfaces, which is what labels need");
  flags.option("--platform-radius", &options.platform_radius_m,
               "metres around the sensor's positions that its platform fills, and that are free of everything else; at "
               "most its smallest extent");
}

double clearRays_m(const std::string& text) {
  if (text == "all") return std::numeric_limits<double>::infinity();
  double metres = 0;
  const char* const end = text.data() + text.size();
  const auto [rest, error] = std::from_chars(text.data(), end, metres);
  if (error == std::errc() && rest == end && metres > 0 && std::isfinite(metres)) return metres;
  throw InvalidArgument("usage.clear_rays", "--clear-rays",
                        "\"" + printable(text) + "\" is not a positive length in metres", "Use for example 20, or all");
}

void addChangeOptions(FlagParser& flags, MapOptions& options) {
  flags.option("--change", &options.change,
               std::string("how the map follows a world that changes: off, block (new things block after a few scans") +
                   (options.forgetful ? ") or full (what rays show to be gone opens, too; the default)"
                                      : "; the default) or full (what rays show to be gone opens, too)"));
  flags.flag("--static", options.still, "the world is still: --change off");
  flags.option("--free-for", &options.free_for,
               std::string("with --change full, seconds after which free space that no ray has confirmed is unknown "
                           "again, by the scans' times; inf = never. Default: ") +
                   (options.forgetful ? "60" : "inf"));
}

void sayChangeNotes(const FieldParams& params, Messages& messages) {
  if (!(params.change.free_for_s < kShortFreeFor_s)) return;
  messages.warning("change.short", "free space is forgotten after " + numberText(params.change.free_for_s) +
                                       " s: what is looked at from some metres away is not confirmed as often; " +
                                       "10 s or more are meant for --free-for");
}

void addScanFlags(FlagParser& flags, MapOptions& options) {
  flags.option("--scans", &options.scans,
               "folder of .pcd, .ply, .bin, .las, .laz or .ptx scans, one file, or a recording (.mcap, .db3, .bag)");
  flags.option("--poses", &options.poses,
               "pose file; may be omitted for VIEWPOINT poses, ray clouds, recordings, --trajectory, --stations and "
               "--sensor-at");
  flags.option("--sensor-at", &options.sensor_at,
               "X,Y,Z of the one sensor position of one cloud in the world frame, in its unit");
}

void addMapFlags(FlagParser& flags, MapOptions& options, const std::string& out) {
  addScanFlags(flags, options);
  addMappingOptions(flags, options);
  flags.option(out, &options.out, "folder for field.vdb, field_points.vdb, points.ply, report.json, preview.png");
  flags.option("--policy", &options.policy, "how points to be scored again are chosen: exact or paper");
  flags.option("--corridor", &options.corridor_m, "length of the straight corridor that must be free, metres");
  flags.option("--update-every", &options.update_every, "score after every n scans; 0 = once at the end");
  flags.option("--max-memory", &options.max_memory, "limit on memory, for example 2G or 500M");
  flags.option("--tiles", &options.tiles,
               "map in tiles with this edge in metres, with the same results: auto (where memory is short) or off");
  flags.option("--bin-memory", &options.bin_memory, "memory for sorting returns into tiles; default by --max-memory");
  flags.flag("--keep-rays", options.keep_rays, "keep the sorted returns after all tiles are done");
  flags.flag("--fresh", options.fresh, "start over where the folder holds tiles of an earlier run");
  flags.option("--origin", &options.origin,
               "X,Y,Z of the map's local origin in the world frame, or a folder with an earlier result");
  flags.flag("--no-clobber", options.no_clobber, "refuse to overwrite existing outputs");
  addCarryOption(flags, options.survey);
  addMirrorOption(flags, options);
  addExportOptions(flags, options.exported);
  addPictureOptions(flags, options.picture);
}

void checkMapOptions(const MapOptions& options) {
  checkCommonOptions(options.common);
  for (const auto& [flag, value, what] :
       {std::tuple{"--scans", options.scans, "a folder of scans or one file"},
        std::tuple{"--tool", options.tool.tool, "a mesh, builtin:pencil or builtin:pruner"},
        std::tuple{"--out", options.out, "the folder for the results"}}) {
    if (value.empty()) throw InvalidArgument("usage.missing", flag, "is missing", std::string("Name ") + what);
  }
  if (options.every < 1) throw InvalidArgument("usage.every", "--every", "must be 1 or more");
  if (options.update_every < 0) throw InvalidArgument("usage.update_every", "--update-every", "cannot be negative");
  if (!options.max_memory.empty()) (void)parseBytes("--max-memory", options.max_memory);
  if (!options.bin_memory.empty()) (void)parseBytes("--bin-memory", options.bin_memory);
  (void)wantedTile_m(options);
  (void)scanInputOptions(options);
  (void)renderOptions(options.picture);
  (void)writeOptions(options.exported);
  (void)fieldParams(options);
  checkCheckpointOptions(options);
  if (!options.survey.crs.empty() && options.exported.points_format != "las") {
    throw InvalidArgument("usage.crs", "--crs", "is what points.las says", "Add --points-format las, or omit it");
  }
  for (const std::string& region : options.remove) (void)parseRegion(region);
  (void)parseRemovedAs(options.removed_as);
}

double wantedTile_m(const MapOptions& options) {
  if (options.tiles == "auto" || options.tiles == "off") return 0;
  double edge_m = 0;
  const char* end = options.tiles.data() + options.tiles.size();
  const auto [rest, error] = std::from_chars(options.tiles.data(), end, edge_m);
  if (error != std::errc() || rest != end || !(edge_m > 0) || !std::isfinite(edge_m)) {
    throw InvalidArgument("usage.tiles", "--tiles", "\"" + options.tiles + "\" is not a positive length in metres",
                          "Use auto, off, or an edge in metres");
  }
  return edge_m;
}

std::optional<std::array<double, 3>> givenOrigin(const MapOptions& options) {
  if (options.origin.empty()) return std::nullopt;
  Eigen::Vector3d origin_W;
  const std::filesystem::path folder = options.origin;
  if (!io::isFolder(folder)) {
    origin_W = parseVector("--origin", options.origin);
  } else if (tiles::hasIndex(folder)) {
    const std::array<double, 3> indexed = tiles::readIndex(folder).origin_W;
    origin_W = {indexed[0], indexed[1], indexed[2]};
  } else {
    origin_W = io::readPointsPly(folder / "points.ply", std::numeric_limits<std::uint32_t>::max()).origin_W;
  }
  std::array<double, 3> rounded;
  for (int axis = 0; axis < 3; ++axis) {
    // + 0.0 turns -0 into 0.
    rounded[static_cast<std::size_t>(axis)] = std::round(origin_W[axis] / options.voxel_m) * options.voxel_m + 0.0;
  }
  return rounded;
}

io::ScanInputOptions scanInputOptions(const MapOptions& options) {
  io::ScanInputOptions input;
  input.scans = options.scans;
  input.poses = options.poses;
  input.pose_format = chooseWord("--pose-format", options.pose_format, kPoseFormats);
  input.calib = options.calib;
  if (!options.sensor_at.empty()) input.sensor_at_W = parseVector("--sensor-at", options.sensor_at);
  input.every = options.every;
  input.allow_truncated = options.allow_truncated;
  input.sort_poses = options.sort_poses;
  applySurveyOptions(options.survey, input);
  input.first_returns = options.exported.points_format == "las";
  applyRecordingOptions(options.recording, input);
  applySensorOptions(options.sensor, input);
  return input;
}

namespace {

/// What --change and --static say; nothing if neither is given.
std::optional<ChangeMode> givenChange(const MapOptions& options) {
  if (options.change.empty()) return options.still ? std::optional(ChangeMode::Off) : std::nullopt;
  const ChangeMode mode = chooseWord<ChangeMode>("--change", options.change);
  if (options.still && mode != ChangeMode::Off) {
    throw InvalidArgument("usage.change", "--change", "contradicts --static", "Omit one of them");
  }
  return mode;
}

/// What --free-for says, or the verb's default.
double freeFor_s(const MapOptions& options, ChangeMode mode) {
  constexpr double kForever_s = std::numeric_limits<double>::infinity();
  if (options.free_for.empty()) return options.forgetful && mode == ChangeMode::Full ? kFreeForLive_s : kForever_s;
  if (options.free_for == "inf") return kForever_s;
  double seconds = 0;
  const char* end = options.free_for.data() + options.free_for.size();
  const auto [rest, error] = std::from_chars(options.free_for.data(), end, seconds);
  if (error != std::errc() || rest != end || !(seconds > 0) || !std::isfinite(seconds)) {
    throw InvalidArgument("usage.free_for", "--free-for",
                          "\"" + printable(options.free_for) + "\" is not a positive time in seconds",
                          "Use for example 60, or inf for free space that stays free");
  }
  if (mode != ChangeMode::Full) {
    throw InvalidArgument("usage.free_for", "--free-for", "is only for --change full", "Add --change full, or omit it");
  }
  return seconds;
}

}  // namespace

FieldParams fieldParams(const MapOptions& options, std::optional<double> recorded_noise_m) {
  // Checked here although the library checks it too: everything below is derived from it.
  if (!(options.voxel_m > 0)) {
    throw InvalidArgument("usage.voxel", "--voxel", "must be a positive length in metres", "Use for example 0.01");
  }
  FieldParams params;
  if (chooseWord("--profile", options.profile, kProfiles) == Profile::Paper)
    params = FieldParams::paper(options.voxel_m);
  params.tsdf.voxel_size_m = options.voxel_m;
  if (recorded_noise_m) params.tsdf.range_noise_m = *recorded_noise_m;
  if (options.range_noise_m) params.tsdf.range_noise_m = *options.range_noise_m;
  if (!options.tau.empty()) {
    params.tsdf.truncation_distance_m = parseLength_m("--tau", options.tau, options.voxel_m);
    if (!(params.tsdf.truncation_distance_m > 0)) {
      throw InvalidArgument("usage.tau", "--tau", "must be positive", "Leave it out for the rule");
    }
  }
  if (options.min_range_m) params.tsdf.min_range_m = *options.min_range_m;
  if (options.max_range_m) params.tsdf.max_range_m = *options.max_range_m;
  if (options.directions) params.approach.num_directions = *options.directions;
  // Of several tools, the first one's.
  const MapOptions own = optionsOfEach(options).front();
  if (!own.orientations.empty()) params.approach.orientations = OrientationSet::parse(own.orientations);
  params.approach.rolls = parseRolls(own.rolls);
  params.scoring.max_collisions = parseMaxCollisions(own.max_collisions, options.voxel_m);
  if (options.corridor_m) params.approach.corridor_length_m = *options.corridor_m;
  if (options.knn) params.scoring.neighbours = *options.knn;
  if (!options.clear_rays.empty()) params.tsdf.clear_rays_m = clearRays_m(options.clear_rays);
  if (options.platform_radius_m) params.tsdf.platform_radius_m = *options.platform_radius_m;
  params.scoring.point_spacing_m = pointSpacing_m(options.points, options.point_spacing, params.tsdf);
  auto change = givenChange(options);
  const bool can_forget = params.tsdf.region == UpdateRegion::DoubleCone && options.policy != "paper";
  if (!change && options.forgetful && can_forget) change = ChangeMode::Full;
  if (change) {
    if (*change != ChangeMode::Off && params.tsdf.region != UpdateRegion::DoubleCone) {
      throw InvalidArgument("usage.change", "--change", "the paper's profile takes the world as still",
                            "Omit it, or use --profile product");
    }
    params.change.mode = *change;
  }
  params.change.free_for_s = freeFor_s(options, params.change.mode);
  if (!options.policy.empty()) params.update.policy = chooseWord<UpdatePolicy>("--policy", options.policy);
  params.backend = chooseWord<BackendKind>("--device", options.common.device);
  params.threads = options.common.threads;
  params.mirror_distance = options.mirror_distance;
  params.fuse_on_host = options.host_fusion;
  if (!options.max_device_memory.empty()) {
    params.device_cache_bytes = parseBytes("--max-device-memory", options.max_device_memory);
  }
  params.origin_W = givenOrigin(options);
  for (const CarriedName& name : carriedNames(options.survey)) params.carry.push_back({name.column, Keep::Majority});
  if (options.survey.index) {
    params.carry.push_back({"scan", Keep::First});
    params.carry.push_back({"index", Keep::First});
  }
  return params.resolved();
}

void printConfig(const FlagParser& flags, const MapOptions& options, const std::string& verb,
                 const std::string& reserve) {
  checkCommonOptions(options.common);
  std::string text = "# " + verb + ": effective configuration, readable by --config\n" + effectiveConfig(flags) +
                     "\n# What follows from it, rules applied" + reserve + ":\n";
  const FieldParams params = fieldParams(options);
  std::istringstream lines(params.describe());
  for (std::string line; std::getline(lines, line);) text += "#   " + line + "\n";
  text += "# If a GPU fuses the scans, it holds at most " +
          numberText(static_cast<double>(params.device_cache_bytes) / 1e9) +
          " GB of values of the map, and at most half of what is free at the start.\n";
  printData(text);
}

}  // namespace accessvdb::tools
