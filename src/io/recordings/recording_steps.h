// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The clouds of a recording as steps: one topic of clouds, posed by odometry, by transforms or by a pose file.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "accessvdb/scan_io.h"
#include "io/clouds/point_times.h"
#include "io/poses/pose_files.h"
#include "io/recordings/recording_index.h"
#include "io/scans/scan_motion.h"

namespace accessvdb::io {

class RecordingSteps {
 public:
  /// Reads all files once, chooses topics, and finds the pose of each cloud.
  /// @param files  one recording, in parts if there are several
  /// @throws InputError, UnusableInput: docs/recordings.md, "Messages"
  RecordingSteps(const std::vector<std::filesystem::path>& files, ScanKind kind, const ScanInputOptions& options);

  [[nodiscard]] std::size_t size() const { return steps_.size(); }
  [[nodiscard]] ScanRecord read(std::size_t step);
  [[nodiscard]] double stamp_s(std::size_t step) const { return seconds(steps_.at(step).stamp_ns); }
  /// As ScanSequence::givenPose().
  [[nodiscard]] std::optional<Eigen::Isometry3d> givenPose(std::size_t step, double shift_s) const;
  /// As ScanSequence::sensorPose().
  [[nodiscard]] std::optional<Eigen::Isometry3d> sensorPose(std::size_t step) const;
  [[nodiscard]] const std::filesystem::path& path(std::size_t step) const { return files_[steps_.at(step).file]; }
  [[nodiscard]] bool deskews() const { return scale_.has_value(); }
  [[nodiscard]] const std::string& rule() const { return rule_; }
  [[nodiscard]] const std::vector<std::string>& notices() const { return notices_; }
  [[nodiscard]] const std::vector<ScanWarning>& warnings() const { return warnings_; }
  [[nodiscard]] std::uint64_t heldBytes() const;

 private:
  /// What the clouds of one frame need.
  struct FrameUse {
    bool registered = false;          ///< the points are where they were measured: in a frame that does not move
    FrameTree::Chain of_points = {};  ///< world to the cloud's frame
    FrameTree::Chain of_sensor = {};  ///< registered: world to the frame whose place is the sensor's
  };
  struct Posed {
    Eigen::Isometry3d T_W_cloud = Eigen::Isometry3d::Identity();
    Eigen::Isometry3d T_W_sensor = Eigen::Isometry3d::Identity();
  };

  void usePoseFile(IndexedTopic& cloud, const ScanInputOptions& options);
  void useOdometry(IndexedTopic& poses, IndexedTopic& cloud, const ScanInputOptions& options);
  void useTransforms(IndexedTopic& cloud);
  /// Clouds in frames that nothing connects to the world are left out, if they are the fewer.
  /// @param usual_is_posed  by a file or an extrinsic, which is for the frame of most clouds
  void leaveOutStrays(IndexedTopic& cloud, bool usual_is_posed);
  [[nodiscard]] FrameTree::Chain requireChain(const std::string& leaf) const;
  void tellAboutClouds(const RecordingIndex& index, const IndexedTopic& cloud);
  void tellAboutOdometry(const IndexedTopic& poses, bool sort);
  void keepPosed(std::vector<IndexedCloud> clouds, const ScanInputOptions& options);
  void leaveOutRepeated(std::vector<IndexedCloud>& clouds);
  void level(const RecordingIndex& index, const Level& level);
  void warnOfTilt(const RecordingIndex& index);
  /// What the IMU felt in the first second with poses, and of which topic and frame.
  struct AtRest {
    std::vector<Eigen::Vector3d> force_W;
    std::string words;
  };
  [[nodiscard]] AtRest forceAtRest(const RecordingIndex& index) const;
  void chooseTimes(const IndexedTopic& cloud);
  [[nodiscard]] Placed placeCloud(const IndexedCloud& indexed, const bags::CloudMessage& cloud,
                                  ScanRecord& record) const;
  [[nodiscard]] CarriedFields carriedOf(const bags::CloudMessage& cloud, std::size_t step) const;
  [[nodiscard]] std::vector<std::int32_t> attributesOf(const bags::CloudMessage& cloud, std::size_t step) const;
  void requireCarried();
  [[nodiscard]] Eigen::Isometry3d onSensor(const Eigen::Isometry3d& T_W_B) const;
  [[nodiscard]] std::optional<Posed> poseAt(std::uint32_t frame, std::int64_t stamp_ns) const;
  [[nodiscard]] std::optional<Posed> poseOf(const IndexedCloud& cloud) const {
    return poseAt(cloud.frame, cloud.stamp_ns);
  }

  std::vector<std::filesystem::path> files_;
  std::string subject_;                                       ///< the recording's name for messages
  std::vector<std::unique_ptr<bags::Recording>> recordings_;  ///< [files]
  std::vector<IndexedCloud> steps_;
  bags::MessageKind cloud_kind_ = bags::MessageKind::PointCloud2;
  bags::Wire wire_ = bags::Wire::Cdr;
  std::string topic_;
  FrameTree frames_;
  std::string world_;             ///< the frame of the result
  std::vector<FrameUse> uses_;    ///< [IndexedTopic::frames]
  std::optional<PoseFile> file_;  ///< instead of frames
  std::optional<Eigen::Isometry3d> T_B_S_;
  std::optional<Eigen::AlignedBox3d> exclude_box_S_;
  Deskew deskew_ = Deskew::Auto;
  std::optional<TimeScale> scale_;  ///< motion within scans is removed
  OffsetRange usual_times_;         ///< of scans that are timed right
  double time_offset_s_ = 0, max_gap_s_ = kMaxPoseGap_s;
  std::vector<std::string> carry_;        ///< attributes of the points
  std::string child_;                     ///< the frame that the odometry poses
  std::optional<Eigen::Matrix3d> R_L_W_;  ///< turns the frame of the poses level
  std::string span_;                      ///< of the poses, for messages
  std::string rule_;
  std::vector<std::string> notices_;
  std::vector<ScanWarning> warnings_;
};

}  // namespace accessvdb::io
