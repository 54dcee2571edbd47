// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Scans with their poses as a sequence of steps: one file per step, or one cloud read in parts.
#include <algorithm>
#include <cmath>
#include <limits>

#include "accessvdb/error.h"
#include "accessvdb/scan_io.h"
#include "io/clouds/cloud_steps.h"
#include "io/clouds/decoder_pipe.h"
#include "io/clouds/point_cloud.h"
#include "io/poses/levelling.h"
#include "io/poses/pose_checks.h"
#include "io/poses/scan_poses.h"
#include "io/poses/station_file.h"
#include "io/recordings/recording_steps.h"
#include "io/scans/deskew_choice.h"
#include "io/scans/exclude_box.h"
#include "io/scans/scan_files.h"
#include "io/scans/scan_motion.h"
#include "io/streams/input_file.h"
#include "io/streams/text_lines.h"

namespace accessvdb::io {
namespace {

/// Limit on notices about single files; more would only be repetitive.
constexpr std::size_t kMaxFileNotices = 20;
/// Returns that are converted at once: few enough to stay in the cache.
constexpr std::size_t kPart = 4096;

/// Scans that are read when a sequence is opened, to learn what their times mean.
constexpr std::size_t kFilesLookedAt = 5;

/// Rounds to float; values beyond float become infinite, so that they are counted as such.
float toFloat(double value) {
  constexpr double kMax = std::numeric_limits<float>::max();
  if (std::abs(value) > kMax)
    return std::copysign(std::numeric_limits<float>::infinity(), static_cast<float>(value > 0 ? 1 : -1));
  return static_cast<float>(value);
}

std::optional<double> readRangeNoise(const std::filesystem::path& path) {
  const std::string file = readInputFile(path);
  LineReader lines(file, forMessage(path.native()));
  std::string_view line;
  std::vector<std::string_view> tokens;
  std::optional<double> noise_m;
  while (lines.next(line)) {
    if (isBlankOrComment(line)) continue;
    splitTokens(line, tokens);
    double value = 0;
    if (noise_m || tokens.size() != 1 || !parseNumber(tokens[0], value) || !(value >= 0 && std::isfinite(value)))
      lines.fail("is not a single range noise in metres, as this file should contain", "Correct or remove the file");
    noise_m = value;
  }
  return noise_m;
}

void checkOptions(const ScanInputOptions& options) {
  if (options.every < 1)
    throw InvalidArgument("usage.every", "ScanInputOptions::every", "must be at least 1", "1 uses all scans");
  if (options.rays_per_step < 1)
    throw InvalidArgument("usage.rays_per_step", "rays_per_step", "must be at least 1", "The default is 20000");
  if (!std::isfinite(options.time_offset_s))
    throw InvalidArgument("usage.time_offset", "time_offset_s", "must be a finite number", "Use seconds");
  if (options.T_B_S) (void)PoseChecker("T_B_S").fromMatrix(options.T_B_S->matrix().topRows<3>(), 0);
  if (const auto& box = options.exclude_box_S; box && !(box->sizes().minCoeff() > 0 && box->sizes().allFinite()))
    throw InvalidArgument("usage.exclude_box", "exclude_box_S", "must have a finite size above 0 along each axis",
                          "Use X0,Y0,Z0,X1,Y1,Z1, the lower corner first");
  if (!options.trajectory.empty() && (!options.poses.empty() || options.sensor_at_W || !options.calib.empty()))
    throw InvalidArgument("usage.trajectory", "ScanInputOptions::trajectory",
                          "excludes ScanInputOptions::poses, sensor_at_W and ScanInputOptions::calib",
                          "Use ScanInputOptions::trajectory for a cloud in the world frame, ScanInputOptions::poses "
                          "for scans in the sensor's");
  if (!options.stations.empty() &&
      (!options.poses.empty() || options.sensor_at_W || !options.calib.empty() || !options.trajectory.empty()))
    throw InvalidArgument(
        "usage.stations", "ScanInputOptions::stations",
        "excludes ScanInputOptions::poses, sensor_at_W, ScanInputOptions::trajectory and ScanInputOptions::calib",
        "Use ScanInputOptions::stations for clouds in the world frame, ScanInputOptions::poses for scans in the "
        "scanner's");
  if (options.level && !(std::abs(options.level->roll_rad) <= 4 && std::abs(options.level->pitch_rad) <= 4))
    throw InvalidArgument("usage.level", "ScanInputOptions::level", "must be two finite angles",
                          "Use ROLL,PITCH in degrees, or imu");
  if (const auto& ray = options.ray_W) {
    if (!(ray->norm() > 0 && ray->norm() <= 1e5))
      throw InvalidArgument("usage.ray", "ray_W", "must be a vector longer than 0, from the sensor to a point",
                            "Use X,Y,Z in metres, for example 0,0,-10 for a flight above the cloud");
    if (!options.poses.empty() || options.sensor_at_W || !options.calib.empty() || !options.trajectory.empty() ||
        !options.stations.empty())
      throw InvalidArgument("usage.ray", "ray_W",
                            "excludes ScanInputOptions::poses, sensor_at_W, ScanInputOptions::trajectory, "
                            "ScanInputOptions::stations and ScanInputOptions::calib",
                            "Omit it where it is known where the sensor was");
  }
  if (!options.sensor_at_W) return;
  if (!options.sensor_at_W->allFinite())
    throw InvalidArgument("usage.sensor_at", "sensor_at_W", "must be three finite numbers", "Use X,Y,Z in metres");
  if (!options.poses.empty())
    throw InvalidArgument("usage.sensor_at", "sensor_at_W", "and a pose file exclude each other",
                          "Omit one of the two");
}

/// What is for one kind of scans only.
void checkKind(const ScanInputOptions& options, const ScanFileList& scans) {
  const bool recording = isRecording(scans.kind);
  for (const auto& [flag, value] : {std::pair("ScanInputOptions::topic", &options.topic),
                                    {"pose_topic", &options.pose_topic},
                                    {"fixed_frame", &options.fixed_frame}})
    if (!recording && !value->empty())
      throw InvalidArgument("usage.recording", flag, "is for recordings (.mcap, .db3, .bag)", "Omit it");
  if (recording &&
      (options.sensor_at_W || !options.calib.empty() || !options.trajectory.empty() || !options.stations.empty()))
    throw InvalidArgument("usage.recording", forMessage(scans.files.front().native()),
                          "is a recording, which excludes sensor_at_W, ScanInputOptions::calib, "
                          "ScanInputOptions::trajectory and ScanInputOptions::stations",
                          "Use its own poses, or ScanInputOptions::poses with a pose file in TUM format");
  if (scans.kind == ScanKind::Ptx && (!options.poses.empty() || options.sensor_at_W || !options.trajectory.empty() ||
                                      !options.stations.empty() || options.ray_W))
    throw InvalidArgument("usage.ptx", forMessage(scans.files.front().native()),
                          "has the scanners' poses in itself (PTX), which excludes ScanInputOptions::poses, "
                          "sensor_at_W, ScanInputOptions::trajectory, "
                          "ScanInputOptions::stations and ray_W",
                          "Omit them");
  if (options.ray_W && recording)
    throw InvalidArgument("usage.recording", "ray_W", "is for clouds in the world frame, not for recordings",
                          "Omit it");
  if (options.level && options.level->from_imu && !recording)
    throw InvalidArgument("usage.level", "Level::from_imu", "is for recordings (.mcap, .db3, .bag)",
                          "Use ScanInputOptions::level ROLL,PITCH in degrees");
  if (options.time_offset_s != 0 && !recording && options.trajectory.empty() && options.poses.empty())
    throw InvalidArgument("usage.time_offset", "time_offset_s", "is for times that are looked up in poses",
                          "Add ScanInputOptions::trajectory or ScanInputOptions::poses, or omit it");
}

}  // namespace

struct ACCESSVDB_PRIVATE ScanSequence::Impl {
  ScanInputOptions options;
  ScanKind kind = ScanKind::Pcd;
  std::vector<std::filesystem::path> scan_files;  ///< one per step, or the single cloud
  std::vector<MatchedScan> poses;                 ///< one per step; empty for one cloud
  bool stamped = false;                           ///< poses have time stamps
  std::vector<Eigen::Vector3d> stations_W;        ///< one per scan file, or none
  std::string laz_command;
  std::vector<std::filesystem::path> other_files;
  std::vector<std::string> notices;
  std::size_t file_notices = 0;
  std::string rule;
  std::optional<double> range_noise_m;
  std::uint64_t input_bytes = 0;
  std::optional<CloudSteps> clouds;         ///< instead of poses: clouds in the world frame
  std::optional<RecordingSteps> recording;  ///< instead of both
  std::vector<PoseEntry> track;             ///< of the sensor, if motion within scans is removed
  std::optional<TimeScale> scale;           ///< motion within scans is removed
  std::vector<ScanWarning> warnings;

  [[nodiscard]] std::size_t size() const {
    return recording ? recording->size() : clouds ? clouds->size() : poses.size();
  }

  void checkStep(std::size_t step) const {
    if (step >= size())
      throw InvalidArgument("usage.step", "step " + std::to_string(step),
                            "is past the end; there are " + std::to_string(size()), "Count from 0");
  }

  void addFileNotices(const std::vector<std::string>& more) {
    for (const std::string& notice : more)
      if (++file_notices <= kMaxFileNotices) notices.push_back(notice);
  }

  void chooseDecoder(const std::filesystem::path& first) {
    laz_command = options.laz_command.empty() ? findLazDecoder() : options.laz_command;
    if (laz_command.empty())
      throw InputError("input.unsupported", forMessage(first.native()),
                       "is compressed (LAZ), and no decoder was found: neither laszip nor las2las is in PATH",
                       "Name one with laz_command, or convert it: laszip -i IN.laz -o OUT.las, or pdal translate "
                       "IN.laz OUT.las");
    notices.push_back("scans: LAZ is decoded by '" + forMessage(laz_command) + "'");
  }

  /// Clouds in the world frame.
  void openClouds(const ScanFileList& scans) {
    if (options.T_B_S || options.exclude_box_S || options.level || options.deskew == Deskew::On)
      throw InvalidArgument("usage.sensor_frame",
                            options.T_B_S           ? "T_B_S"
                            : options.exclude_box_S ? "exclude_box_S"
                            : options.level         ? "ScanInputOptions::level"
                                                    : "Deskew::On",
                            "needs the sensor's frame, which clouds in the world frame do not have",
                            "Use scans in the sensor's frame, or a recording");
    CloudInput input{.files = scans.files,
                     .kind = kind,
                     .read = {.allow_truncated = options.allow_truncated,
                              .keep_noise = options.keep_noise,
                              .laz_command = laz_command},
                     .time_offset_s = options.time_offset_s,
                     .rays_per_step = options.rays_per_step,
                     .every = options.every};
    if (!options.trajectory.empty()) {
      if (kind != ScanKind::Las && kind != ScanKind::Laz && kind != ScanKind::Ply)
        throw InvalidArgument(
            "usage.trajectory", "ScanInputOptions::trajectory", "needs a time for each return",
            "Use .las, .laz or .ply in the world frame; for scans in the sensor's frame ScanInputOptions::poses");
      input.read.times = true;
      input.trajectory = Trajectory::read(options.trajectory, options.sort_poses);
      other_files.push_back(options.trajectory);
      rule =
          "matching: the time of each return gives the sensor's position on the trajectory, interpolated over gaps of "
          "at "
          "most 0.2 s, world frame";
    } else if (!options.stations.empty()) {
      other_files.push_back(options.stations);
      input.sensors_W = stations_W;
      rule = "matching: each file of the stations has its scanner's position (" + std::to_string(stations_W.size()) +
             " stations), world frame";
    } else if (options.ray_W) {
      input.ray_W = *options.ray_W;
      rule = "matching: each point was seen along the given ray, world frame";
      warnings.push_back({"scans.constant_ray",
                          "ray_W says from where each point was seen; nothing measured it, and where it is wrong, "
                          "space counts as free that may not be"});
    } else if (options.sensor_at_W) {
      input.sensors_W = {*options.sensor_at_W};
      rule = "matching: one cloud in the world frame, seen from the given sensor position";
    } else if (kind == ScanKind::Ptx) {
      input.read.rays = true;
      rule = "matching: each station of a PTX has its scanner's position and pose in its header, world frame";
    } else {
      input.read.rays = true;
      rule = "matching: ray cloud, each point has its own sensor position (point + nx ny nz), world frame";
    }
    clouds.emplace(std::move(input));
    addFileNotices(clouds->notices());
    if (const auto& doubts = clouds->unitDoubts(); !doubts.empty())
      warnings.push_back(
          {"scans.unit", doubts.front() + (doubts.size() > 1 ? ", and so for others" : "") +
                             ". Compare the size of the map, or write the file again with its projection"});
    scan_files = scans.files;
  }

  void openRecording(const ScanFileList& scans) {
    recording.emplace(scans.files, kind, options);
    scan_files = scans.files;
    rule = recording->rule();
    notices.insert(notices.end(), recording->notices().begin(), recording->notices().end());
    warnings = recording->warnings();
    if (!options.poses.empty()) other_files.push_back(options.poses);
  }

  void openScans(const ScanFileList& scans) {
    ScanPoses found = posesForScans(scans, options);
    notices.insert(notices.end(), found.notices.begin(), found.notices.end());
    notices.insert(notices.end(), found.match.notices.begin(), found.match.notices.end());
    other_files = std::move(found.files);
    rule = found.match.rule;
    stamped = found.stamped;
    if (options.T_B_S) notices.push_back("poses: those of the sensor, by T_B_S");
    Eigen::Isometry3d T_L_W = Eigen::Isometry3d::Identity();
    if (options.level) {
      T_L_W.linear() = levellingOf(options.level->roll_rad, options.level->pitch_rad);
      rule += ", turned level by ScanInputOptions::level (" + levelInWords(T_L_W.linear()) + ")";
    }
    const auto ofSensor = [&](Eigen::Isometry3d& T_W_S) {
      if (options.T_B_S) T_W_S = T_W_S * *options.T_B_S;
      if (options.level) T_W_S = T_L_W * T_W_S;
    };
    for (std::size_t i = 0; i < found.match.scans.size(); i += static_cast<std::size_t>(options.every)) {
      poses.push_back(found.match.scans[i]);
      ofSensor(poses.back().T_W_S);
      scan_files.push_back(scans.files[found.match.scans[i].scan]);
    }
    track = std::move(found.track);
    for (PoseEntry& pose : track) ofSensor(pose.T_W_S);
    chooseTimes();
    if (!scale) track = {};
  }

  /// Whether motion within scans can be removed.
  void chooseTimes() {
    TimedScans timed;
    timed.subject = forMessage(scan_files.front().parent_path().native());
    timed.scans = poses.size();
    const bool timed_kind = kind == ScanKind::Pcd || kind == ScanKind::Ply;
    timed.posed_by_time = stamped && !track.empty();
    const bool looked = options.deskew != Deskew::Off && timed_kind && timed.posed_by_time;
    const std::size_t stride = std::max<std::size_t>(1, poses.size() / kFilesLookedAt);
    for (std::size_t step = 0; looked && step < poses.size(); step += stride) {
      const auto reader = openScan(step);
      if (timed.field.empty()) timed.field = reader->timeField();
      if (reader->timeField().empty()) break;
      const PointCloud cloud = readWhole(*reader);
      if (const auto span = timeSpanOf(cloud.points, cloud.times, clockStamp_s(step))) timed.samples.push_back(*span);
    }
    timed.covered = [this](const OffsetRange& range) {
      return static_cast<std::size_t>(std::count_if(poses.begin(), poses.end(), [&](const MatchedScan& scan) {
        return interpolatePose(track, scan.stamp_s + range.first_s) &&
               interpolatePose(track, scan.stamp_s + range.last_s);
      }));
    };
    const DeskewChoice choice = chooseDeskew(options.deskew, timed);
    scale = choice.scale;
    rule += choice.words;
  }

  /// The stamp of a scan on the clock of its points.
  [[nodiscard]] double clockStamp_s(std::size_t step) const { return poses[step].stamp_s - options.time_offset_s; }

  [[nodiscard]] std::unique_ptr<CloudReader> openScan(std::size_t step) const {
    return io::openCloud(scan_files[step], kind,
                         {.allow_truncated = options.allow_truncated,
                          .point_times = options.deskew != Deskew::Off,
                          .keep_noise = options.keep_noise,
                          .laz_command = laz_command});
  }

  /// @return false if the scan has to be used as it is
  bool removeMotion(const std::vector<double>& times, std::size_t step, ScanRecord& record) const {
    if (times.size() != record.points_S.size()) {
      if (options.deskew != Deskew::On) return false;
      throw UnusableInput("deskew.no_times", forMessage(scan_files[step].native()), "has no times of points",
                          "Leave out ScanInputOptions::deskew to use such scans as they are");
    }
    const double stamp_s = poses[step].stamp_s;
    const TimedScan scan = {record.points_S, times, *scale, clockStamp_s(step), record.T_W_S, options.exclude_box_S};
    MovedScan moved = io::removeMotion(
        scan, [&](std::int64_t ms) { return interpolatePose(track, stamp_s + static_cast<double>(ms) * 1e-3); });
    if (options.deskew != Deskew::On && !coversScan(moved)) return false;
    record.points_S.clear();
    takeMoved(std::move(moved), record);
    return true;
  }

  ScanRecord readScan(std::size_t step) {
    const MatchedScan& pose = poses.at(step);
    const std::filesystem::path& path = scan_files[step];
    const auto reader = openScan(step);
    ScanRecord record;
    record.path = path.string();
    record.T_W_S = pose.T_W_S;
    record.stamp_s = pose.stamp_s;
    record.points_S.reserve(reader->expectedPoints());
    CloudTotals totals;
    std::vector<double> times;
    for (std::size_t read = kPart; read == kPart;) {
      const PointCloud part = reader->next(kPart);
      for (const Eigen::Vector3d& p : part.points)
        record.points_S.emplace_back(toFloat(p[0]), toFloat(p[1]), toFloat(p[2]));
      times.insert(times.end(), part.times.begin(), part.times.end());
      totals.add(part);
      read = part.points.size();
    }
    record.truncated_points = totals.truncated_points;
    record.noise_points = totals.left_out.all();
    record.step_m = reader->step_m();
    addFileNotices(reader->notices(totals));
    if (scale && removeMotion(times, step, record)) return record;
    if (options.exclude_box_S)
      record.excluded_points = leaveOutInside(*options.exclude_box_S, Eigen::Isometry3d::Identity(), record.points_S);
    return record;
  }
};

ScanSequence::ScanSequence(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
ScanSequence::~ScanSequence() = default;
ScanSequence::ScanSequence(ScanSequence&&) noexcept = default;
ScanSequence& ScanSequence::operator=(ScanSequence&&) noexcept = default;

ScanSequence ScanSequence::open(const ScanInputOptions& options) {
  checkOptions(options);
  auto impl = std::make_unique<Impl>();
  impl->options = options;
  ScanFileList scans;
  if (options.stations.empty()) {
    scans = listScans(options.scans);
  } else {
    StationList stations = readStations(options.scans, options.stations);
    scans = std::move(stations.scans);
    impl->stations_W = std::move(stations.positions_W);
  }
  impl->kind = scans.kind;
  impl->notices = scans.notices;
  if (scans.kind == ScanKind::Laz) impl->chooseDecoder(scans.files.front());
  const bool single = scans.files.size() == 1;
  if (options.sensor_at_W && !single && !isRecording(scans.kind))
    throw InvalidArgument("usage.sensor_at", "sensor_at_W",
                          "is for one cloud, but the folder contains " + std::to_string(scans.files.size()) + " scans",
                          "Use one file, or poses for all scans");
  const bool ray_cloud =
      (single && scans.kind == ScanKind::Ply && options.poses.empty()) || scans.kind == ScanKind::Ptx || options.ray_W;
  checkKind(options, scans);
  if (isRecording(scans.kind)) {
    impl->openRecording(scans);
  } else if (!options.trajectory.empty() || !options.stations.empty() || options.sensor_at_W || ray_cloud) {
    impl->openClouds(scans);
  } else {
    impl->openScans(scans);
  }
  impl->notices.push_back(impl->rule);
  for (const auto& file : impl->scan_files) impl->input_bytes += inputFileSize(file);
  if (const auto noise = besideScans(scans, "range_noise.txt")) {
    impl->range_noise_m = readRangeNoise(*noise);
    impl->other_files.push_back(*noise);
  }
  return ScanSequence(std::move(impl));
}

std::size_t ScanSequence::size() const { return impl_->size(); }

ScanRecord ScanSequence::read(std::size_t step) {
  impl_->checkStep(step);
  if (impl_->recording) return impl_->recording->read(step);
  return impl_->clouds ? impl_->clouds->read(step) : impl_->readScan(step);
}

std::optional<double> ScanSequence::stamp_s(std::size_t step) const {
  impl_->checkStep(step);
  if (impl_->recording) return impl_->recording->stamp_s(step);
  if (impl_->clouds) return impl_->clouds->stamp_s(step);
  if (!impl_->stamped) return std::nullopt;
  return impl_->poses[step].stamp_s;
}

bool ScanSequence::deskews() const { return impl_->recording ? impl_->recording->deskews() : impl_->scale.has_value(); }

std::string ScanSequence::path(std::size_t step) const {
  impl_->checkStep(step);
  if (impl_->recording) return impl_->recording->path(step).string();
  return (impl_->clouds ? impl_->clouds->path(step) : impl_->scan_files[step]).string();
}

const std::vector<std::string>& ScanSequence::notices() const { return impl_->notices; }
const std::vector<ScanWarning>& ScanSequence::warnings() const { return impl_->warnings; }
std::string ScanSequence::matchingRule() const { return impl_->rule; }

std::vector<std::string> ScanSequence::paths() const {
  std::vector<std::string> paths;
  for (const auto& files : {impl_->scan_files, impl_->other_files})
    for (const auto& file : files) paths.push_back(file.string());
  return paths;
}

std::optional<double> ScanSequence::recordedRangeNoise_m() const { return impl_->range_noise_m; }
std::uint64_t ScanSequence::heldBytes() const {
  return impl_->poses.size() * sizeof(MatchedScan) + impl_->track.capacity() * sizeof(PoseEntry) +
         (impl_->clouds ? impl_->clouds->heldBytes() : 0) + (impl_->recording ? impl_->recording->heldBytes() : 0);
}
std::uint64_t ScanSequence::inputBytes() const { return impl_->input_bytes; }

}  // namespace accessvdb::io
