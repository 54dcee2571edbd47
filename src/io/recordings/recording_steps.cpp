// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/recordings/recording_steps.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "accessvdb/error.h"
#include "io/poses/levelling.h"
#include "io/poses/pose_checks.h"
#include "io/poses/pose_matching.h"
#include "io/recordings/frame_names.h"
#include "io/recordings/recording_topics.h"
#include "io/recordings/stamp_words.h"
#include "io/scans/deskew_choice.h"
#include "io/scans/exclude_box.h"
#include "io/scans/scan_motion.h"
#include "io/streams/input_file.h"

namespace accessvdb::io {
namespace {

std::string metresText(double value) {
  char text[64];
  std::snprintf(text, sizeof text, "%.1f m", value);
  return text;
}
std::string subjectOf(const std::vector<std::filesystem::path>& files) {
  return forMessage(files.size() == 1 ? files.front().native() : files.front().parent_path().native());
}

}  // namespace

RecordingSteps::RecordingSteps(const std::vector<std::filesystem::path>& files, ScanKind kind,
                               const ScanInputOptions& options)
    : files_(files),
      subject_(subjectOf(files)),
      frames_(nanoseconds(options.max_gap_s)),
      T_B_S_(options.T_B_S),
      exclude_box_S_(options.exclude_box_S),
      deskew_(options.deskew),
      time_offset_s_(options.time_offset_s),
      max_gap_s_(options.max_gap_s),
      carry_(options.carry) {
  for (const auto& file : files_) recordings_.push_back(openRecording(file, kind, options.allow_truncated));
  RecordingIndex index = indexRecording({.files = files_,
                                         .kind = kind,
                                         .allow_truncated = options.allow_truncated,
                                         .topic = options.topic,
                                         .pose_topic = options.pose_topic,
                                         .times = options.deskew != Deskew::Off,
                                         .imu = !options.level || options.level->from_imu,
                                         .max_gap_s = options.max_gap_s},
                                        recordings_);
  for (const std::string& line : index.cut_offs) warnings_.push_back({"recording.cut_off", line});
  IndexedTopic& cloud = chooseCloudTopic(index, options.topic, subject_);
  cloud.requireReadable(subject_, warnings_);
  topic_ = cloud.topic.name;
  cloud_kind_ = *cloud.kind;
  wire_ = *cloud.wire;
  tellAboutClouds(index, cloud);
  world_ = plainFrame(options.fixed_frame);
  IndexedTopic* const poses =
      options.poses.empty() ? choosePoseTopic(index, cloud, options.pose_topic, subject_) : nullptr;
  frames_ = std::move(index.transforms);
  if (!options.poses.empty()) {
    usePoseFile(cloud, options);
  } else if (poses != nullptr) {
    useOdometry(*poses, cloud, options);
  } else {
    useTransforms(cloud);
  }
  if (options.poses.empty() && poses == nullptr)
    for (const IndexedTopic& topic : index.topics)
      if (topic.kind == bags::MessageKind::Transforms && topic.wire) topic.requireReadable(subject_, warnings_);
  if (index.thinned_ns > 0)
    notices_.push_back("recording: poses less than " + std::to_string(index.thinned_ns / 1'000'000) +
                       " ms after another are not used, to save memory");
  if (T_B_S_) rule_ += ", with T_B_S";
  if (!uses_.empty() && !T_B_S_)
    if (const auto T_B_points = frames_.links().onMovingFrame(uses_.front().of_points))
      warnOfFarExtrinsic(T_B_points->translation(), "the recording's fixed transform of " + wordForMessage(topic_),
                         warnings_);
  if (options.level) {
    level(index, *options.level);
  } else {
    warnOfTilt(index);
  }
  keepPosed(std::move(cloud.clouds), options);
  requireCarried();
  chooseTimes(cloud);
}

void RecordingSteps::tellAboutClouds(const RecordingIndex& index, const IndexedTopic& cloud) {
  std::string others;
  for (const IndexedTopic& topic : index.topics)
    if (&topic != &cloud && topic.isReadCloud() && topic.topic.messages > 0)
      others += (others.empty() ? "; not used: " : ", ") + wordForMessage(topic.topic.name);
  notices_.push_back("recording: clouds from " + topicInWords(cloud) + others);
  if (cloud.unstamped > 0)
    notices_.push_back("recording: " + std::to_string(cloud.unstamped) +
                       " clouds have no time; the time of their recording is used");
}

void RecordingSteps::usePoseFile(IndexedTopic& cloud, const ScanInputOptions& options) {
  if (!options.pose_topic.empty())
    throw InvalidArgument("usage.pose_topic", "pose_topic", "and ScanInputOptions::poses exclude each other",
                          "Omit one of the two");
  file_ = readPoseFile(options.poses, options.pose_format, {}, options.sort_poses);
  if (!file_->stamped)
    throw UnusableInput("poses.no_stamps", file_->subject, "has no time stamps, which the clouds of a recording need",
                        "Use a pose file in TUM format, on the recording's clock");
  notices_.insert(notices_.end(), file_->notices.begin(), file_->notices.end());
  warnings_.insert(warnings_.end(), file_->warnings.begin(), file_->warnings.end());
  leaveOutStrays(cloud, true);
  for (const std::string& frame : cloud.frames) uses_.push_back({.registered = !world_.empty() && frame == world_});
  const auto& poses = file_->poses;
  span_ = std::to_string(poses.size()) + " poses from " +
          spanText(nanoseconds(poses.front().stamp_s), nanoseconds(poses.back().stamp_s));
  rule_ = "matching: time of a cloud = time stamp of " + file_->subject +
          (uses_.front().registered ? ", clouds are in the fixed frame" : "");
}

FrameTree::Chain RecordingSteps::requireChain(const std::string& leaf) const {
  if (auto chain = frames_.chain(world_, leaf)) return *std::move(chain);
  std::string edges;
  for (const std::string& edge : frames_.links().edges(20)) edges += (edges.empty() ? "" : ", ") + wordForMessage(edge);
  throw UnusableInput(
      "recording.frames", subject_,
      "frame " + frameText(leaf) + " of " + wordForMessage(topic_) + " is not connected to frame " + frameText(world_) +
          "; known are " + (edges.empty() ? "none" : edges),
      "Record /tf and /tf_static, choose another pose_topic or fixed_frame, or use ScanInputOptions::poses");
}

void RecordingSteps::useOdometry(IndexedTopic& poses, IndexedTopic& cloud, const ScanInputOptions& options) {
  poses.requireReadable(subject_, warnings_);
  tellAboutOdometry(poses, options.sort_poses);
  const std::string parent = poses.frames.front().empty() ? kWorldFrame : poses.frames.front();
  if (world_.empty()) world_ = parent;
  const auto isRegistered = [&](const std::string& frame) { return frame == parent || frame == world_; };
  // Poses that do not say whose they are: the sensor's, which is the cloud's frame unless that does not move.
  std::string child = poses.child;
  if (child.empty()) {
    child = mostUsedFrame(cloud, isRegistered).value_or(kSensorFrame);
  }
  child_ = child;
  const std::string whose = child == kSensorFrame ? "the sensor" : frameText(child);
  frames_.replace(parent, child, std::move(poses.poses));
  frames_.finish();
  leaveOutStrays(cloud, T_B_S_.has_value());
  for (const std::string& frame : cloud.frames) {
    FrameUse use;
    use.registered = isRegistered(frame);
    // The extrinsic says where the sensor is on what is posed, whatever transforms say.
    use.of_points = requireChain(T_B_S_ && !use.registered ? child : frame);
    if (use.registered) use.of_sensor = requireChain(child);
    uses_.push_back(std::move(use));
  }
  const bool registered = uses_.front().registered;
  rule_ = "matching: " + wordForMessage(topic_) + " is in frame " + frameText(cloud.frames.front()) +
          (registered ? ", which does not move: registered already; rays begin where " : ", posed in frame ") +
          (registered ? whose : frameText(world_)) + (registered ? " is, by " : " by ") +
          wordForMessage(poses.topic.name);
  if (!registered && uses_.front().of_points.from_leaf.size() + uses_.front().of_points.from_root.size() > 1)
    rule_ += " and transforms (" + frames_.links().inWords(uses_.front().of_points) + ")";
}

void RecordingSteps::tellAboutOdometry(const IndexedTopic& poses, bool sort) {
  const std::string name = wordForMessage(poses.topic.name);
  const PoseTrack::Counts& counts = poses.poses.counts();
  if (poses.poses.empty())
    throw UnusableInput("poses.none", subject_, name + " has no valid pose", "Choose another pose_topic");
  if (counts.backwards > 0 && !sort)
    throw UnusableInput("poses.reversed", subject_,
                        name + " runs backwards in time " + std::to_string(counts.backwards) + " times",
                        "Use sort_poses to sort it by time");
  span_ = std::to_string(poses.poses.size()) + " poses from " + spanText(poses.poses.first_ns(), poses.poses.last_ns());
  const auto tell = [&](std::uint64_t count, const std::string& what) {
    if (count > 0) notices_.push_back("poses: " + std::to_string(count) + " of " + name + " " + what);
  };
  tell(counts.backwards, "were earlier than the one before, and have been sorted");
  tell(counts.repeated, "are dropped: another one has the same time");
  if (counts.invalid > 0)
    warnings_.push_back({"poses.skipped", std::to_string(counts.invalid) + " of " + name +
                                              " are skipped: not finite, or not a rotation"});
  tell(poses.other_frames, "are dropped: between other frames than the first one");
  tell(poses.unstamped, "have no time; the time of their recording is used");
  if (counts.jumps > 0)
    warnings_.push_back({"poses.jumps", name + " jumps " + std::to_string(counts.jumps) + " times, first at " +
                                            secondsText(counts.first_jump_ns) + " s, by up to " +
                                            metresText(counts.largest_jump_m) +
                                            " at over 50 m/s: the map may be torn there"});
}

void RecordingSteps::useTransforms(IndexedTopic& cloud) {
  if (T_B_S_)
    throw InvalidArgument("usage.extrinsic", "T_B_S", "is for odometry and poses: transforms pose the sensor itself",
                          "Omit it, or choose odometry with pose_topic");
  frames_.finish();
  if (world_.empty()) {
    const auto usual = mostUsedFrame(cloud, [](const std::string&) { return false; });
    const auto top = frames_.links().top(usual.value_or(cloud.frames.front()));
    if (top) world_ = *top;
  }
  leaveOutStrays(cloud, false);
  for (const std::string& frame : cloud.frames) {
    if (frame == world_)
      throw UnusableInput("poses.none", subject_,
                          wordForMessage(topic_) + " is in frame " + frameText(frame) +
                              ", which does not move, and nothing says where the sensor was",
                          "Record the odometry too, or choose another ScanInputOptions::topic");
    uses_.push_back({.of_points = requireChain(frame)});
  }
  rule_ = "matching: " + wordForMessage(topic_) + " is in frame " + frameText(cloud.frames.front()) +
          ", posed in frame " + frameText(world_) + " by transforms (" +
          frames_.links().inWords(uses_.front().of_points) + ")";
  span_ = std::to_string(frames_.poses()) + " transforms";
  const auto tell = [&](std::uint64_t count, const std::string& what) {
    if (count > 0) notices_.push_back("poses: " + std::to_string(count) + " transforms are dropped: " + what);
  };
  if (frames_.invalid() > 0)
    warnings_.push_back({"poses.skipped",
                         std::to_string(frames_.invalid()) + " transforms are skipped: not finite, or not a rotation"});
  tell(frames_.links().otherParents(), "their frame was posed in another one before");
  if (frames_.jumps() > 0)
    warnings_.push_back({"poses.jumps", "transforms jump " + std::to_string(frames_.jumps()) +
                                            " times at over 50 m/s: the map may be torn there"});
}

Eigen::Isometry3d RecordingSteps::onSensor(const Eigen::Isometry3d& T_W_B) const {
  return T_B_S_ ? T_W_B * *T_B_S_ : T_W_B;
}

void RecordingSteps::level(const RecordingIndex& index, const Level& level) {
  if (!level.from_imu) {
    R_L_W_ = levellingOf(level.roll_rad, level.pitch_rad);
    rule_ += ", turned level by ScanInputOptions::level";
    return;
  }
  const AtRest rest = forceAtRest(index);
  R_L_W_ = levellingOf(rest.force_W, subject_);
  rule_ += rest.words + " (" + levelInWords(*R_L_W_) + ")";
}

void RecordingSteps::warnOfTilt(const RecordingIndex& index) {
  const auto up_W = upByForce(forceAtRest(index).force_W);
  constexpr double kTilted_rad = 10 * std::numbers::pi / 180;
  if (!up_W || std::acos(std::clamp(up_W->z(), -1.0, 1.0)) <= kTilted_rad) return;
  warnings_.push_back({"poses.up", "z is not up: at the start, what the IMU feels is " + tiltInWords(*up_W) +
                                       ". ScanInputOptions::level imu turns the world level"});
}

RecordingSteps::AtRest RecordingSteps::forceAtRest(const RecordingIndex& index) const {
  AtRest rest;
  std::vector<Eigen::Vector3d>& force_W = rest.force_W;
  for (const IndexedTopic& topic : index.topics) {
    if (topic.imu.empty() || !force_W.empty()) continue;
    std::string whose = topic.frames.front();
    auto chain = frames_.chain(world_, whose);
    if (!chain && !child_.empty()) {
      whose = child_;
      chain = frames_.chain(world_, whose);
    }
    std::optional<std::int64_t> first_ns;
    for (const ImuSample& sample : topic.imu) {
      std::optional<Eigen::Isometry3d> T_W_I;
      if (file_) {
        T_W_I = interpolatePose(file_->poses, seconds(sample.stamp_ns), max_gap_s_);
      } else if (chain) {
        T_W_I = frames_.at(*chain, sample.stamp_ns);
      }
      if (!T_W_I || !sample.force.allFinite()) continue;
      if (!first_ns) first_ns = sample.stamp_ns;
      constexpr std::int64_t kRest_ns = 1'000'000'000;
      if (sample.stamp_ns - *first_ns <= kRest_ns) force_W.push_back(T_W_I->linear() * sample.force);
    }
    if (!force_W.empty())
      rest.words = ", turned level by " + wordForMessage(topic.topic.name) +
                   (file_ ? std::string(", taken to be what the poses are of") : " in frame " + frameText(whose));
  }
  return rest;
}

void RecordingSteps::chooseTimes(const IndexedTopic& cloud) {
  TimedScans timed;
  timed.registered = uses_.front().registered;
  timed.subject = subject_ + " " + wordForMessage(topic_);
  timed.field = cloud.time_field;
  timed.samples = cloud.spans;
  if (cloud_kind_ == bags::MessageKind::LivoxCustom) timed.scale = TimeScale{1e-9, false};
  timed.scans = steps_.size();
  timed.covered = [this](const OffsetRange& range) {
    const auto ns = [](double offset_s) {
      return static_cast<std::int64_t>(std::clamp(offset_s, -kLongestScan_s, kLongestScan_s) * 1e9);
    };
    return static_cast<std::size_t>(std::count_if(steps_.begin(), steps_.end(), [&](const IndexedCloud& step) {
      return poseAt(step.frame, step.stamp_ns + ns(range.first_s)) &&
             poseAt(step.frame, step.stamp_ns + ns(range.last_s));
    }));
  };
  timed.max_gap_s = max_gap_s_;
  const DeskewChoice choice = chooseDeskew(deskew_, timed);
  scale_ = choice.scale;
  usual_times_ = choice.usual;
  rule_ += choice.words;
}

Placed RecordingSteps::placeCloud(const IndexedCloud& indexed, const bags::CloudMessage& cloud,
                                  ScanRecord& record) const {
  const bool registered = uses_[indexed.frame].registered;
  const bool insist = deskew_ == Deskew::On && !registered;
  if (!cloud.time) {
    if (!insist) return Placed::AsIs;
    throw UnusableInput("deskew.no_times", record.path,
                        "the cloud at " + secondsText(indexed.stamp_ns) + " s has no times of points",
                        "Leave out ScanInputOptions::deskew to use such clouds as they are");
  }
  std::vector<double> times;
  bags::appendTimes(cloud, times);
  const TimesOfScan of = {times,      *scale_, usual_times_,  seconds(indexed.stamp_ns) - time_offset_s_,
                          registered, insist,  exclude_box_S_};
  return placeByTimes(
      of,
      [&](std::int64_t ms) -> std::optional<Eigen::Isometry3d> {
        const auto at = poseAt(indexed.frame, indexed.stamp_ns + ms * 1'000'000);
        if (!at) return std::nullopt;
        return at->T_W_sensor;
      },
      record);
}

std::optional<RecordingSteps::Posed> RecordingSteps::poseAt(std::uint32_t frame, std::int64_t stamp_ns) const {
  const auto levelled = [this](Posed posed) {
    if (!R_L_W_) return posed;
    posed.T_W_cloud = *R_L_W_ * posed.T_W_cloud;
    posed.T_W_sensor = *R_L_W_ * posed.T_W_sensor;
    return posed;
  };
  const FrameUse& use = uses_.at(frame);
  Posed posed;
  if (file_) {
    const auto T_W_B = interpolatePose(file_->poses, seconds(stamp_ns), max_gap_s_);
    if (!T_W_B) return std::nullopt;
    posed.T_W_sensor = onSensor(*T_W_B);
    if (!use.registered) posed.T_W_cloud = posed.T_W_sensor;
    return levelled(posed);
  }
  const auto T_W_points = frames_.at(use.of_points, stamp_ns);
  if (!T_W_points) return std::nullopt;
  if (!use.registered) {
    posed.T_W_cloud = posed.T_W_sensor = onSensor(*T_W_points);
    return levelled(posed);
  }
  const auto T_W_B = frames_.at(use.of_sensor, stamp_ns);
  if (!T_W_B) return std::nullopt;
  posed.T_W_cloud = *T_W_points;
  posed.T_W_sensor = onSensor(*T_W_B);
  return levelled(posed);
}

std::optional<Eigen::Isometry3d> RecordingSteps::givenPose(std::size_t step, double shift_s) const {
  const IndexedCloud& cloud = steps_.at(step);
  if (uses_[cloud.frame].registered) return std::nullopt;
  const auto posed = poseAt(cloud.frame, cloud.stamp_ns + nanoseconds(shift_s));
  if (!posed) return std::nullopt;
  Eigen::Isometry3d T_W_B = posed->T_W_sensor;
  if (R_L_W_) T_W_B = Eigen::Isometry3d(R_L_W_->transpose()) * T_W_B;
  if (T_B_S_) T_W_B = T_W_B * T_B_S_->inverse();
  return T_W_B;
}

std::optional<Eigen::Isometry3d> RecordingSteps::sensorPose(std::size_t step) const {
  const IndexedCloud& cloud = steps_.at(step);
  const auto posed = uses_[cloud.frame].registered ? std::nullopt : poseOf(cloud);
  if (!posed) return std::nullopt;
  return posed->T_W_sensor;
}

ScanRecord RecordingSteps::read(std::size_t step) {
  const IndexedCloud& indexed = steps_.at(step);
  const std::optional<Posed> posed = poseOf(indexed);
  ScanRecord record;
  record.path = path(step).string();
  record.stamp_s = seconds(indexed.stamp_ns);
  try {
    const bags::CloudMessage cloud =
        bags::readCloud(cloud_kind_, recordings_[indexed.file]->read(indexed.place), wire_);
    const bool registered = uses_[indexed.frame].registered;
    if (registered) {
      bags::appendPoints(cloud, record.points_W);
      moveRegistered(posed->T_W_cloud, record.points_W);
    } else {
      bags::appendPoints(cloud, record.points_S);
    }
    record.attributes = attributesOf(cloud, step);
    record.T_W_S = posed->T_W_sensor;
    const Placed placed = scale_ ? placeCloud(indexed, cloud, record) : Placed::AsIs;
    if (placed == Placed::OtherTimes) {
      record.points_S.clear();
      record.points_W.clear();
      record.attributes.clear();
      record.skipped = "the cloud at " + secondsText(indexed.stamp_ns) + " s has times that are not those of its scan";
    }
    if (placed == Placed::AsIs) placeAtOnce(registered, exclude_box_S_, record);
    if (registered) record.T_W_S = Eigen::Isometry3d::Identity();
    return record;
  } catch (const bags::MessageError&) {
    throw InputError("input.changed", forMessage(path(step).native()), "changed since it was first read",
                     "Wait until it is complete");
  }
}

std::uint64_t RecordingSteps::heldBytes() const {
  std::uint64_t bytes = steps_.capacity() * sizeof(IndexedCloud) + frames_.heldBytes();
  if (file_) bytes += file_->poses.capacity() * sizeof(PoseEntry);
  for (const auto& recording : recordings_) bytes += recording->heldBytes();
  return bytes;
}

}  // namespace accessvdb::io
