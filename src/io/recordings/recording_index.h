// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// One pass over the files of a recording: where its clouds are, and all of its poses. Clouds are not kept.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "accessvdb/scan_io.h"
#include "bags/messages.h"
#include "bags/recording.h"
#include "io/clouds/point_cloud.h"
#include "io/clouds/point_times.h"
#include "io/poses/frame_tree.h"
#include "io/poses/levelling.h"
#include "io/poses/pose_track.h"

namespace accessvdb::io {

[[nodiscard]] constexpr bool isRecording(ScanKind kind) {
  return kind == ScanKind::Mcap || kind == ScanKind::RosBag || kind == ScanKind::Sqlite;
}

/// @throws InputError as readInputFile and bags::Recording
[[nodiscard]] std::unique_ptr<bags::Recording> openRecording(const std::filesystem::path& path, ScanKind kind,
                                                             bool allow_truncated);

struct IndexedCloud {
  std::int64_t stamp_ns = 0;
  bags::Place place;
  std::uint32_t file = 0;
  std::uint32_t frame = 0;  ///< of IndexedTopic::frames
};

struct IndexedTopic {
  bags::Topic topic;                        ///< counts and times over all files
  std::optional<bags::MessageKind> kind;    ///< nothing for types that are not read
  std::optional<bags::Wire> wire;           ///< nothing for encodings that are not read
  std::vector<std::string> frames;          ///< of the headers, at most kMostFrameNames
  std::string child;                        ///< odometry: the frame that is posed
  std::vector<IndexedCloud> clouds;         ///< in the order of the files
  std::string time_field;                   ///< of the points of the first cloud; empty without
  std::vector<TimeSpan> spans;              ///< of the first clouds with returns that have times, kTimedSamples at most
  std::vector<ImuSample> imu;               ///< the first ones, only with IndexRequest::imu
  PoseTrack poses;                          ///< of odometry and poses, finished
  std::uint64_t other_frames = 0;           ///< poses that were dropped: between other frames than the first one
  std::uint64_t unstamped = 0;              ///< messages without a time: that of their recording is used
  std::optional<bags::MessageError> error;  ///< of the first message that could not be read
  std::uint64_t first_bad = 0;              ///< which one that was, from 1
  std::uint64_t seen = 0, bad = 0;          ///< messages, and those of them that could not be read

  [[nodiscard]] bool isReadCloud() const { return kind && wire && bags::isCloud(*kind); }
  [[nodiscard]] bool isReadPose() const { return kind && wire && bags::isPose(*kind); }
  /// One bad message costs that message. @throws InputError if half of the messages could not be read
  void requireReadable(const std::string& subject, std::vector<ScanWarning>& warnings) const;
};
inline constexpr std::size_t kMostFrameNames = 64;

struct RecordingIndex {
  explicit RecordingIndex(double max_gap_s) : transforms(nanoseconds(max_gap_s)) {}

  std::vector<IndexedTopic> topics;
  FrameTree transforms;               ///< not finished: odometry may be put into it
  std::vector<std::string> cut_offs;  ///< one line for each file that is not whole
  std::int64_t thinned_ns = 0;        ///< poses nearer to each other were dropped, to bound the memory

  [[nodiscard]] std::uint64_t heldBytes() const;
};

struct IndexRequest {
  std::vector<std::filesystem::path> files = {};
  ScanKind kind = ScanKind::Mcap;
  bool allow_truncated = false;
  std::string topic = {}, pose_topic = {};  ///< empty: all of them
  bool times = false;                       ///< the times of points are looked at
  bool imu = false;                         ///< measurements of an IMU are kept
  double max_gap_s = kMaxPoseGap_s;         ///< see PoseTrack
  bool list_only = false;                   ///< clouds and poses are looked at, but not kept
};

/// @param recordings  [files] @throws InputError, ResourceLimit "limit.recording"
[[nodiscard]] RecordingIndex indexRecording(const IndexRequest& request,
                                            const std::vector<std::unique_ptr<bags::Recording>>& recordings);

}  // namespace accessvdb::io
