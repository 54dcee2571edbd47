// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/recordings/recording_index.h"

#include <algorithm>
#include <map>
#include <tuple>

#include "accessvdb/error.h"
#include "io/scans/deskew_choice.h"
#include "io/streams/input_file.h"

namespace accessvdb::io {
namespace {

/// 64 MiB each: 29 hours of clouds at 10 Hz; poses beyond are thinned.
constexpr std::size_t kMostClouds = std::size_t{1} << 20;
constexpr std::size_t kMostPoses = std::size_t{1} << 19;
constexpr std::int64_t kFirstThinning_ns = 1'000'000;
/// Interpolation needs a pose within kMaxPoseGap_s.
constexpr std::int64_t kLastThinning_ns = 100'000'000;

class FileInput final : public bags::ByteInput {
 public:
  explicit FileInput(const std::filesystem::path& path) : file_(path), size_(file_.size()) {
    const std::string subject = forMessage(path.native());
    if (size_ == 0) throw InputError("input.empty", subject, "is empty (0 bytes)", "Copy the file again");
    std::string begin(std::min<std::uint64_t>(size_, kLfsPointer.size()), '\0');
    read(0, begin.data(), begin.size());
    refuseLfsPointer(begin, subject);
  }
  [[nodiscard]] std::uint64_t size() const override { return size_; }
  void read(std::uint64_t offset, char* to, std::size_t count) const override {
    if (offset > size_ || count > size_ - offset || file_.readAt(offset, to, count) != count) file_.throwChanged();
  }

 private:
  InputDescriptor file_;
  std::uint64_t size_;
};

class Indexer {
 public:
  explicit Indexer(const IndexRequest& request) : request_(request), index_(request.max_gap_s) {}

  void add(std::uint32_t file, bags::Recording& recording) {
    file_ = file;
    of_file_.clear();
    recording.scan([this](const bags::Topic& topic) { return wanted(topic); },
                   [this, &recording](const bags::Message& message) { add(recording, message); });
    std::uint64_t messages = 0;
    for (const bags::Topic& topic : recording.topics()) {
      IndexedTopic& known = topicOf(topic);
      const bool first = known.topic.messages == 0;
      if (topic.messages > 0) {
        known.topic.first_ns = first ? topic.first_ns : std::min(known.topic.first_ns, topic.first_ns);
        known.topic.last_ns = first ? topic.last_ns : std::max(known.topic.last_ns, topic.last_ns);
      }
      known.topic.messages += topic.messages;
      messages += topic.messages;
    }
    if (const auto& reason = recording.cutOff())
      index_.cut_offs.push_back(forMessage(request_.files[file].native()) + " " + *reason + "; " +
                                std::to_string(messages) + " messages before that are read");
  }

  RecordingIndex finish() {
    for (IndexedTopic& topic : index_.topics) topic.poses.finish();
    return std::move(index_);
  }

 private:
  [[nodiscard]] bool wanted(const bags::Topic& topic) const {
    const auto kind = bags::kindOf(topic.type);
    if (!kind || !bags::wireOf(topic.encoding)) return false;
    if (*kind == bags::MessageKind::Transforms) return true;
    if (*kind == bags::MessageKind::Imu) return request_.imu;
    const std::string& name = bags::isCloud(*kind) ? request_.topic : request_.pose_topic;
    return name.empty() || name == topic.name;
  }

  IndexedTopic& topicOf(const bags::Topic& topic) {
    const auto [known, added] =
        index_of_.emplace(std::tuple(topic.name, topic.type, topic.encoding), index_.topics.size());
    if (added) {
      index_.topics.emplace_back();
      IndexedTopic& fresh = index_.topics.back();
      fresh.topic.name = topic.name;
      fresh.topic.type = topic.type;
      fresh.topic.encoding = topic.encoding;
      fresh.kind = bags::kindOf(topic.type);
      fresh.wire = bags::wireOf(topic.encoding);
      fresh.poses = PoseTrack(nanoseconds(request_.max_gap_s));
    }
    return index_.topics[known->second];
  }

  void add(bags::Recording& recording, const bags::Message& message) {
    // Looked up once for each file and topic.
    while (of_file_.size() <= message.topic) {
      const bags::Topic& topic = recording.topics()[of_file_.size()];
      of_file_.push_back(static_cast<std::size_t>(&topicOf(topic) - index_.topics.data()));
    }
    IndexedTopic& topic = index_.topics[of_file_[message.topic]];
    ++topic.seen;
    const std::size_t clouds = topic.clouds.size();
    try {
      if (bags::isCloud(*topic.kind)) {
        addCloud(topic, message);
      } else if (*topic.kind == bags::MessageKind::Transforms) {
        addTransforms(topic, message);
      } else if (*topic.kind == bags::MessageKind::Imu) {
        addImu(topic, message);
      } else {
        addPose(topic, message);
      }
    } catch (const bags::MessageError& error) {
      topic.clouds.resize(clouds);
      if (topic.bad++ > 0) return;
      topic.error = error;
      topic.first_bad = topic.seen;
    }
  }

  static std::optional<std::uint32_t> frameOf(IndexedTopic& topic, std::string_view name) {
    const auto known = std::find(topic.frames.begin(), topic.frames.end(), name);
    const auto index = static_cast<std::uint32_t>(known - topic.frames.begin());
    if (known != topic.frames.end()) return index;
    if (topic.frames.size() >= kMostFrameNames) return std::nullopt;
    topic.frames.emplace_back(name);
    return index;
  }

  /// Drivers without a clock send no time.
  static std::int64_t stampOf(IndexedTopic& topic, std::int64_t stamp_ns, const bags::Message& message) {
    if (stamp_ns != 0) return stamp_ns;
    ++topic.unstamped;
    return std::clamp(message.logged_ns, -kMostStamp_ns, kMostStamp_ns);
  }

  void addCloud(IndexedTopic& topic, const bags::Message& message) {
    const bags::CloudMessage cloud = bags::readCloud(*topic.kind, message.bytes, *topic.wire);
    const auto frame = frameOf(topic, cloud.header.frame);
    if (!frame)
      throw bags::MessageError("recording.message", "is in the 65th frame of its topic",
                               "Name another topic with ScanInputOptions::topic");
    if (request_.list_only) return;
    if (++clouds_ > kMostClouds)
      throw ResourceLimit("limit.recording", forMessage(request_.files[file_].native()),
                          "has more than " + std::to_string(kMostClouds) + " clouds",
                          "Name one topic with ScanInputOptions::topic, or split the recording");
    topic.clouds.push_back({stampOf(topic, cloud.header.stamp_ns, message), message.place, file_, *frame});
    if (request_.times) addTimes(topic, cloud);
  }

  void addTimes(IndexedTopic& topic, const bags::CloudMessage& cloud) {
    if (!cloud.time || topic.spans.size() >= kTimedSamples) return;
    topic.time_field = cloud.time->name;
    points_.clear();
    times_.clear();
    bags::appendPoints(cloud, points_);
    bags::appendTimes(cloud, times_);
    if (const auto span = timeSpanOf(points_, times_, seconds(topic.clouds.back().stamp_ns)))
      topic.spans.push_back(*span);
  }

  void addImu(IndexedTopic& topic, const bags::Message& message) {
    const bags::ImuMessage imu = bags::readImu(message.bytes, *topic.wire);
    (void)frameOf(topic, imu.header.frame);
    if (topic.imu.size() >= kMostImuSamples) return;
    topic.imu.push_back({stampOf(topic, imu.header.stamp_ns, message), imu.force, imu.turn_rad_s});
  }

  void addPose(IndexedTopic& topic, const bags::Message& message) {
    const bags::PoseMessage pose = bags::readPose(*topic.kind, message.bytes, *topic.wire);
    const bool first = topic.frames.empty();
    const auto frame = frameOf(topic, pose.header.frame);
    if (first) topic.child = pose.child;
    if (request_.list_only) return;
    if (frame != 0U || pose.child != topic.child) {
      ++topic.other_frames;
      return;
    }
    const std::size_t before = topic.poses.size();
    topic.poses.add(stampOf(topic, pose.header.stamp_ns, message), pose.p, pose.q);
    poses_ += topic.poses.size() - before;
    boundPoses();
  }

  void addTransforms(IndexedTopic& topic, const bags::Message& message) {
    const bool fixed = topic.topic.name.ends_with("tf_static");
    for (const bags::PoseMessage& pose : bags::readTransforms(message.bytes, *topic.wire)) {
      index_.transforms.add(pose.header.frame, pose.child, stampOf(topic, pose.header.stamp_ns, message), pose.p,
                            pose.q, fixed);
      boundPoses();
    }
  }

  void boundPoses() {
    if (poses_ + index_.transforms.poses() <= kMostPoses) return;
    for (index_.thinned_ns = std::max(kFirstThinning_ns, index_.thinned_ns);; index_.thinned_ns *= 2) {
      index_.transforms.thin(index_.thinned_ns);
      poses_ = 0;
      for (IndexedTopic& topic : index_.topics) {
        topic.poses.thin(index_.thinned_ns);
        poses_ += topic.poses.size();
      }
      if (poses_ + index_.transforms.poses() <= kMostPoses / 2) return;
      if (index_.thinned_ns > kLastThinning_ns)
        throw ResourceLimit("limit.recording", forMessage(request_.files[file_].native()),
                            "has more poses than the " + std::to_string(kMostPoses) + " that are kept",
                            "Name one topic with pose_topic, or use ScanInputOptions::poses with a pose file");
    }
  }

  const IndexRequest& request_;
  RecordingIndex index_;
  std::map<std::tuple<std::string, std::string, std::string>, std::size_t> index_of_;
  std::vector<std::size_t> of_file_;  ///< [topic of the file] topic of the index
  std::uint32_t file_ = 0;
  std::size_t clouds_ = 0, poses_ = 0;
  std::vector<Eigen::Vector3f> points_;  // of the cloud whose times are looked at
  std::vector<double> times_;
};

}  // namespace

std::unique_ptr<bags::Recording> openRecording(const std::filesystem::path& path, ScanKind kind, bool allow_truncated) {
  const bags::OpenRecording open = {path, forMessage(path.native()), allow_truncated};
  auto input = std::make_unique<FileInput>(path);
  if (kind == ScanKind::Mcap) return bags::openMcap(std::move(input), open);
  if (kind == ScanKind::RosBag) return bags::openRosBag(std::move(input), open);
  return bags::openSqlite(std::move(input), open);
}

void IndexedTopic::requireReadable(const std::string& subject, std::vector<ScanWarning>& warnings) const {
  if (!error) return;
  const std::string first =
      "message " + std::to_string(first_bad) + " (" + wordForMessage(topic.type) + ") " + error->what();
  if (2 * bad >= seen)
    throw InputError(error->id(), subject + " " + wordForMessage(topic.name), first, error->advice());
  warnings.push_back({isReadCloud() ? "scans.skipped" : "poses.skipped",
                      std::to_string(bad) + " of " + std::to_string(seen) + " messages of " +
                          wordForMessage(topic.name) + " are skipped: " + first});
}

std::uint64_t RecordingIndex::heldBytes() const {
  std::uint64_t bytes = transforms.heldBytes();
  for (const IndexedTopic& topic : topics)
    bytes += topic.clouds.capacity() * sizeof(IndexedCloud) + topic.poses.heldBytes();
  return bytes;
}

RecordingIndex indexRecording(const IndexRequest& request,
                              const std::vector<std::unique_ptr<bags::Recording>>& recordings) {
  Indexer indexer(request);
  for (std::size_t file = 0; file < recordings.size(); ++file)
    indexer.add(static_cast<std::uint32_t>(file), *recordings[file]);
  return indexer.finish();
}

}  // namespace accessvdb::io
