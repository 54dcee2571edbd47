// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Scans with their poses as a sequence of steps: one file per step, or one cloud read in parts.
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

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
#include "io/scans/missing_attributes.h"
#include "io/scans/scan_checks.h"
#include "io/scans/scan_files.h"
#include "io/scans/scan_motion.h"
#include "io/scans/scan_options.h"
#include "io/scans/skipped_scans.h"
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
  OffsetRange usual_times;                  ///< of scans that are timed right
  std::vector<ScanWarning> warnings;
  SkippedScans skipped;  ///< on being read
  SurveyFrame frame;
  MissingAttributes missing;  ///< on being read

  [[nodiscard]] std::size_t size() const {
    return recording ? recording->size() : clouds ? clouds->size() : poses.size();
  }

  void checkStep(std::size_t step) const {
    if (step >= size())
      throw InvalidArgument("usage.step", "step " + std::to_string(step),
                            "is past the end; there are " + std::to_string(size()), "Count from 0");
  }

  [[nodiscard]] bool isLas() const { return kind == ScanKind::Las || kind == ScanKind::Laz; }
  /// What is carried besides the attributes that have names.
  void addCarried() {
    if (options.index) options.carry.insert(options.carry.end(), {kScanName, kRowName});
    if (options.first_returns && isLas())
      options.carry.insert(options.carry.end(), std::begin(kFirstReturnNames), std::end(kFirstReturnNames));
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
                              .carry = options.carry,
                              .crs_wkt = options.crs_wkt,
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
      input.trajectory = Trajectory::read(options.trajectory, options.sort_poses, options.max_gap_s);
      other_files.push_back(options.trajectory);
      rule =
          "matching: the time of each return gives the sensor's position on the trajectory, interpolated over gaps of "
          "at most " +
          gapInWords(options.max_gap_s) + ", world frame";
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
    frame = clouds->frame();
    addFileNotices(clouds->notices());
    if (const auto& doubts = clouds->unitDoubts(); !doubts.empty())
      warnings.push_back(
          {"scans.unit", doubts.front() + (doubts.size() > 1 ? ", and so for others" : "") +
                             ". Compare the size of the map, or write the file again with its projection"});
    if (const auto& doubts = clouds->systemDoubts(); !doubts.empty())
      warnings.push_back(
          {"scans.crs", doubts.front() + (doubts.size() > 1 ? ", and so for others" : "") +
                            ". Say the coordinate system with crs_wkt, or write the file again with its projection"});
    scan_files = scans.files;
  }

  void openRecording(const ScanFileList& scans) {
    recording.emplace(scans.files, kind, options);
    scan_files = scans.files;
    rule = recording->rule();
    notices.insert(notices.end(), recording->notices().begin(), recording->notices().end());
    warnings.insert(warnings.end(), recording->warnings().begin(), recording->warnings().end());
    if (!options.poses.empty()) other_files.push_back(options.poses);
  }

  static void keepOtherMeasurements(const ScanPoses& found, std::vector<ScanCheck>& checks) {
    std::map<std::size_t, const MatchedScan*> of_file;
    for (const MatchedScan& scan : found.match.scans) of_file[scan.scan] = &scan;
    for (std::size_t i = 0; i < checks.size(); ++i) {
      if (!checks[i].twin || !of_file.contains(i)) continue;
      const auto twin = of_file.find(*checks[i].twin);
      const MatchedScan& scan = *of_file.at(i);
      const bool again = twin != of_file.end() && isSamePose(scan.T_W_S, twin->second->T_W_S) &&
                         (!found.stamped || std::abs(scan.stamp_s - twin->second->stamp_s) <= kSameStamp_s);
      if (!again) checks[i].twin.reset();
    }
  }

  /// Leaves out files that are no scans, or are there twice. @return whether there were any
  bool leaveOut(const std::vector<ScanCheck>& checks, ScanFileList& scans) {
    std::size_t kept = 0;
    for (std::size_t i = 0; i < checks.size(); ++i) {
      if (!checks[i].isUsed()) continue;
      if (!stations_W.empty()) stations_W[kept] = stations_W[i];
      scans.files[kept++] = scans.files[i];
    }
    if (checks.empty() || kept == checks.size()) return false;
    scans.files.resize(kept);
    if (!stations_W.empty()) stations_W.resize(kept);
    return true;
  }

  /// Files that are no scans have poses, too, as far as the file of poses knows; copies may not. Where they have
  /// others, or other times, they are scans of their own: of a sensor without noise.
  ScanPoses posesOf(ScanFileList& scans, std::vector<ScanCheck>& checks) {
    if (options.poses.empty()) {
      (void)leaveOut(checks, scans);
      return posesForScans(scans, options);
    }
    try {
      ScanPoses found = posesForScans(scans, options);
      keepOtherMeasurements(found, checks);
      std::erase_if(found.match.scans,
                    [&](const MatchedScan& scan) { return !checks.empty() && !checks[scan.scan].isUsed(); });
      if (!found.match.scans.empty()) return found;
    } catch (const UnusableInput&) {
      if (!leaveOut(checks, scans)) throw;
      return posesForScans(scans, options);
    }
    throw UnusableInput("poses.no_match", forMessage(options.poses.native()), "has no pose for a scan that can be read",
                        "Use poses of this recording");
  }

  void openScans(ScanFileList scans, std::vector<ScanCheck> checks) {
    const std::vector<std::filesystem::path> all = scans.files;
    ScanPoses found = posesOf(scans, checks);
    warnOfScanFiles(checks, all, warnings);
    warnings.insert(warnings.end(), found.warnings.begin(), found.warnings.end());
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
    CarriedCheck carried(options.carry);
    for (std::size_t step = 0; step < poses.size() && !carried.hasAll(); ++step)
      carried.note(openScan(step)->carried(), forMessage(scan_files[step].native()));
    carried.require();
    chooseTimes();
  }

  /// Without what was added to the poses as they were given: the extrinsic, and the turn that levels them.
  [[nodiscard]] std::optional<Eigen::Isometry3d> givenPose(std::size_t step, double shift_s) const {
    if (recording) return recording->givenPose(step, shift_s);
    if (clouds) return std::nullopt;
    std::optional<Eigen::Isometry3d> T_W_S = poses[step].T_W_S;
    if (shift_s != 0) T_W_S = interpolatePose(track, poses[step].stamp_s + shift_s);
    if (!T_W_S) return std::nullopt;
    if (options.level)
      T_W_S = Eigen::Isometry3d(levellingOf(options.level->roll_rad, options.level->pitch_rad).transpose()) * *T_W_S;
    if (options.T_B_S) T_W_S = *T_W_S * options.T_B_S->inverse();
    return T_W_S;
  }

  /// Whether motion within scans can be removed.
  void chooseTimes() {
    TimedScans timed;
    timed.subject = forMessage(scan_files.front().parent_path().native());
    timed.max_gap_s = options.max_gap_s;
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
        return interpolatePose(track, scan.stamp_s + range.first_s, options.max_gap_s) &&
               interpolatePose(track, scan.stamp_s + range.last_s, options.max_gap_s);
      }));
    };
    const DeskewChoice choice = chooseDeskew(options.deskew, timed);
    scale = choice.scale;
    usual_times = choice.usual;
    rule += choice.words;
  }

  /// The stamp of a scan on the clock of its points.
  [[nodiscard]] double clockStamp_s(std::size_t step) const { return poses[step].stamp_s - options.time_offset_s; }

  [[nodiscard]] std::unique_ptr<CloudReader> openScan(std::size_t step) const {
    return io::openCloud(scan_files[step], kind,
                         {.allow_truncated = options.allow_truncated,
                          .point_times = options.deskew != Deskew::Off,
                          .keep_noise = options.keep_noise,
                          .carry = options.carry,
                          .scan = static_cast<std::int32_t>(step),
                          .crs_wkt = options.crs_wkt,
                          .laz_command = laz_command});
  }

  [[nodiscard]] Placed placeScan(const std::vector<double>& times, std::size_t step, ScanRecord& record) const {
    if (times.size() != record.points_S.size()) {
      if (options.deskew != Deskew::On) return Placed::AsIs;
      throw UnusableInput("deskew.no_times", forMessage(scan_files[step].native()), "has no times of points",
                          "Leave out ScanInputOptions::deskew to use such scans as they are");
    }
    const double stamp_s = poses[step].stamp_s;
    const bool insist = options.deskew == Deskew::On;
    return placeByTimes(
        {times, *scale, usual_times, clockStamp_s(step), false, insist, options.exclude_box_S},
        [&](std::int64_t ms) {
          return interpolatePose(track, stamp_s + static_cast<double>(ms) * 1e-3, options.max_gap_s);
        },
        record);
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
      record.attributes.insert(record.attributes.end(), part.attributes.begin(), part.attributes.end());
      totals.add(part);
      read = part.points.size();
    }
    record.truncated_points = totals.truncated_points;
    record.noise_points = totals.left_out.all();
    record.step_m = reader->step_m();
    addFileNotices(reader->notices(totals));
    const Placed placed = scale ? placeScan(times, step, record) : Placed::AsIs;
    if (placed == Placed::OtherTimes) {
      record.points_S.clear();
      record.attributes.clear();
      record.skipped = forMessage(path.filename().native(), 64) + " has times that are not those of its scan";
    }
    if (placed != Placed::AsIs) return record;
    placeAtOnce(false, options.exclude_box_S, record);
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
  impl->addCarried();
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
  if (options.T_B_S) warnOfFarExtrinsic(options.T_B_S->translation(), "T_B_S", impl->warnings);
  const bool in_world =
      !options.trajectory.empty() || !options.stations.empty() || options.sensor_at_W.has_value() || ray_cloud;
  if (!in_world && !isRecording(scans.kind) && scans.kind != ScanKind::Pcd && options.poses.empty())
    (void)posesForScans(scans, options);  // there are none, which says more than what the files are like
  std::vector<ScanCheck> checks;
  if (!single && !isRecording(scans.kind)) checks = checkScanFiles(scans.files, scans.kind);
  if (isRecording(scans.kind)) {
    impl->openRecording(scans);
  } else if (in_world) {
    for (std::size_t i = 0; i < checks.size(); ++i)
      if (checks[i].twin && !impl->stations_W.empty() && impl->stations_W[i] != impl->stations_W[*checks[i].twin])
        checks[i].twin.reset();
    warnOfScanFiles(checks, scans.files, impl->warnings);
    (void)impl->leaveOut(checks, scans);
    impl->openClouds(scans);
  } else {
    impl->openScans(scans, std::move(checks));
  }
  impl->notices.push_back(impl->rule);
  impl->frame.first_returns = options.first_returns && impl->isLas();
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
  ScanRecord record = impl_->recording ? impl_->recording->read(step)
                      : impl_->clouds  ? impl_->clouds->read(step)
                                       : impl_->readScan(step);
  if (impl_->clouds) placeNoReturns(record);
  if (!record.skipped.empty()) impl_->skipped.add(step, record.skipped, impl_->size());
  impl_->missing.note(record.attributes, impl_->options.carry, step);
  return record;
}

std::optional<double> ScanSequence::stamp_s(std::size_t step) const {
  impl_->checkStep(step);
  if (impl_->recording) return impl_->recording->stamp_s(step);
  if (impl_->clouds) return impl_->clouds->stamp_s(step);
  if (!impl_->stamped) return std::nullopt;
  return impl_->poses[step].stamp_s;
}

std::optional<Eigen::Isometry3d> ScanSequence::givenPose(std::size_t step, double shift_s) const {
  impl_->checkStep(step);
  return impl_->givenPose(step, shift_s);
}

std::optional<Eigen::Isometry3d> ScanSequence::sensorPose(std::size_t step) const {
  impl_->checkStep(step);
  if (impl_->recording) return impl_->recording->sensorPose(step);
  if (impl_->clouds) return std::nullopt;
  return impl_->poses[step].T_W_S;
}

bool ScanSequence::deskews() const { return impl_->recording ? impl_->recording->deskews() : impl_->scale.has_value(); }

std::string ScanSequence::path(std::size_t step) const {
  impl_->checkStep(step);
  if (impl_->recording) return impl_->recording->path(step).string();
  return (impl_->clouds ? impl_->clouds->path(step) : impl_->scan_files[step]).string();
}

const std::vector<std::string>& ScanSequence::notices() const { return impl_->notices; }
const std::vector<ScanWarning>& ScanSequence::warnings() const { return impl_->warnings; }
std::vector<ScanWarning> ScanSequence::readWarnings() const {
  std::vector<ScanWarning> warnings = impl_->skipped.warnings(impl_->size());
  impl_->missing.addWarnings(
      impl_->size(), [this](std::size_t step) { return path(step); }, warnings);
  return warnings;
}
const SurveyFrame& ScanSequence::frame() const { return impl_->frame; }
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
