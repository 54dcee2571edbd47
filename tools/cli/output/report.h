// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// report.json: what a run of `map` read, did, used and wrote, even if it failed.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/live_session.h"
#include "accessvdb/program/scan_agreement.h"
#include "accessvdb/region.h"
#include "accessvdb/scan_io.h"
#include "accessvdb/surface_points.h"
#include "accessvdb/tiles.h"
#include "accessvdb/types.h"
#include "output/error_output.h"
#include "output/output_record.h"

namespace accessvdb::tools {

/// Milliseconds of one stage, or a count, one sample per call.
class StageTimes {
 public:
  /// @param most  samples that are kept, the last ones; 0 = all
  explicit StageTimes(std::size_t most = 0) : most_(most) {}
  void add(double ms) {
    if (most_ == 0 || samples_ms_.size() < most_) {
      samples_ms_.push_back(ms);
    } else {
      samples_ms_[next_] = ms;
      next_ = (next_ + 1) % most_;
    }
  }
  [[nodiscard]] bool empty() const { return samples_ms_.empty(); }
  [[nodiscard]] double mean() const;
  /// Nearest rank; share in (0, 1]. 0 if there is no sample.
  [[nodiscard]] double percentile(double share) const;

 private:
  std::size_t most_, next_ = 0;
  std::vector<double> samples_ms_;
};

/// What a run in tiles adds.
struct TilesReport {
  std::int32_t tile_voxels = 0, margin_voxels = 0;
  std::uint64_t done = 0, todo = 0, split = 0;
  std::uint64_t ray_bytes = 0;   ///< of the sorted returns on disk
  double seconds = 0;            ///< of all tiles, as if one process had run them
  std::uint64_t peak_bytes = 0;  ///< of the process that used most
  std::vector<tiles::Poison> poison;
};

/// What a live run adds.
/// What a command to a live run was answered.
struct LiveAnswer {
  std::string id = "null";  ///< as JSON, as sent
  std::string command;
  bool done = false;
  std::string words;
};

struct LiveCommandReport {
  std::uint64_t received = 0, done = 0, refused = 0;
  std::uint64_t unanswered = 0;     ///< of received: they came while too many answers waited to be published
  std::vector<LiveAnswer> answers;  ///< the latest ones
};

struct LiveReport {
  LiveStatus status;
  std::uint64_t malformed = 0;  ///< messages that are not what their type says
  std::uint64_t lost = 0;       ///< messages that the middleware says did not arrive
  LiveCommandReport commands = {};
};

/// One of several tools, as given.
struct ReportedTool {
  std::string name, tool, unit, tip, axis, up, sha256, orientations;
  int rolls = 0, max_collisions = 0, collision_limit = 0;
  double margin_m = 0;           ///< by which it is grown
  std::uint64_t accessible = 0;  ///< points that it reaches
};

/// What --remove took out of the map.
struct RemovalReport {
  std::string region;  ///< in words
  Removal removal;
};

struct RunReport {
  int exit_code = 0;
  std::string device = "cpu";
  std::string device_note_id, device_note;                      ///< of the GPU (AccessibilityField::deviceNote())
  std::vector<std::pair<std::string, std::string>> parameters;  ///< flags as given, then every effective parameter
  std::vector<io::InputFile> inputs;
  OutputEntries outputs;            ///< written by this run into the folder of the report
  bool replaces_files = false;      ///< files of an earlier result may have been replaced
  std::vector<ReportedTool> tools;  ///< if there are several

  std::optional<std::uint64_t> resumed_after_scans;  ///< of --resume; times are those of the scans after them
  std::uint64_t scans = 0, points_in = 0, points_used = 0;
  std::uint64_t scans_fused_on_device = 0;  ///< of scans, those that this run took
  std::uint64_t noise_points = 0;           ///< not among points_in: io::ScanInputOptions::keep_noise
  std::array<std::uint64_t, kNumDropReasons> dropped = {};
  std::uint64_t contradicted_platforms = 0;  ///< FrameStats
  std::uint64_t surface_points = 0;
  std::array<std::uint64_t, kNumPointLabels> labels = {};
  std::array<std::uint64_t, kNumPointReasons> reasons = {};

  StageTimes frame, integrate, mirror, update, score;
  StageTimes changed_leaves, mirror_bytes;  ///< per scan: leaves and bytes patched
  /// The same for the mirror of distances; empty if there is none.
  StageTimes distance_mirror, distance_leaves, distance_mirror_bytes;
  std::optional<std::uint64_t> predicted_bytes;
  MemoryUse memory;
  std::optional<io::ScanAgreement> agreement;
  std::vector<RemovalReport> removals;
  std::optional<TilesReport> tiles;
  std::optional<LiveReport> live;
  std::optional<Failure> failure;

  void add(const FrameStats& stats);
  /// The same with times. @param with_distance  whether there is a mirror of distances
  void addScan(const FrameStats& stats, bool with_distance);
};

/// @param device  AccessibilityField::deviceName()
[[nodiscard]] inline bool isGpu(const std::string& device) { return device.starts_with("cuda"); }

/// Fills in what the points and the map are. @return the points' bounds, world frame
Eigen::AlignedBox3d countPoints(RunReport& report, const MemoryUse& memory, const SurfacePoints& points);

/// What a live run took, dropped and waited for, as in report.json and in the topic /accessvdb/status: a JSON object.
[[nodiscard]] std::string liveJson(const LiveReport& live);

/// @throws OutputError
void writeReport(const std::filesystem::path& path, const RunReport& report, const Messages& messages);

/// Writes the report of a run that failed into its output folder, or nothing where that cannot be done: the original
/// failure is what the user needs to see, and an unwritable folder often is that failure. The report of an earlier
/// result stays where it is until the run replaces files of it.
/// @param keep  leave a report that is there already
void writeFailure(const std::string& out, bool keep, RunReport report, const Failure& failure,
                  const Messages& messages);

}  // namespace accessvdb::tools
