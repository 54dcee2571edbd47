// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// An accessibility field that is fed while the scanner runs: scans and poses go in as they arrive, in whatever way
/// they arrive; labels come out scan by scan.
///
///     LiveSession session(tool, params, options);
///     // From the threads that receive:
///     session.addPose({stamp_ns, p_W, q_W_B});
///     session.addScan({stamp_ns, std::move(points_S)});
///     // From one thread:
///     while (running) {
///       session.waitForWork(std::chrono::milliseconds(100));
///       if (const auto step = session.step()) publish(step->changed);
///     }
///
/// A scan waits until there are poses around its time. If more than LiveOptions::queue_scans wait, the oldest are fused
/// without labels of their own, so that a slow machine falls back in labels, not in what it knows. Every scan is taken,
/// dropped for a reason that is counted, or still waiting: published = taken + dropped + waiting at any time.
///
/// The same sequence of calls gives the same bits, and the labels after a step that is not late are those of
/// AccessibilityField::integrateScan() and update() for each scan that was taken, in that order: those of
/// `accessvdb map --update-every 1`. Clocks only measure; nothing is decided by them, but for LiveOptions::budget_ms.
///
/// What is left out blocks: a return for which there was no memory or no time never makes a point accessible
/// (AccessibilityField::stopGrowing(), leaveOut()). With LiveOptions::rolling the memory limit leaves nothing out: what
/// the sensor has left goes into a folder. Only returns without a pose are merely counted. Where more scans
/// were lost before their poses came than can be remembered, nothing is accessible any more (LiveStatus::all_closed).
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/export.h"
#include "accessvdb/params.h"
#include "accessvdb/region.h"
#include "accessvdb/rolling_field.h"
#include "accessvdb/scan_io.h"
#include "accessvdb/table_progress.h"
#include "accessvdb/tool_geometry.h"
#include "accessvdb/types.h"

namespace accessvdb {

struct ToolSpec;
namespace io {
struct ScanAgreement;
}  // namespace io

/// Why a scan was not taken. Names in files and messages: name(ScanDrop).
enum class ScanDrop : std::uint8_t {
  QueueFull,   ///< there was not even time to fuse it: points near its returns are unscored from then on
  NoPose,      ///< no poses around its time within 0.2 s, or a jump between them
  OutOfOrder,  ///< not later than the scan before it, or waiting and over 10 s later than one that came after it
  Unusable,    ///< no time, more returns than LiveOptions::most_returns, or times of points that cannot be its own
  Failed,      ///< the step that took it threw
  Paused,      ///< it came after pause()
  Reset        ///< it waited at reset()
};
inline constexpr int kNumScanDrops = 7;
constexpr const char* name(ScanDrop reason) {
  constexpr const char* kNames[kNumScanDrops] = {"queue_full", "no_pose", "out_of_order", "unusable",
                                                 "failed",     "paused",  "reset"};
  return kNames[static_cast<int>(reason)];
}

struct LiveOptions {
  std::size_t queue_scans = 4;  ///< if more wait, the oldest are only fused
  /// Of all scans that wait (one of less than 100 counts as 100, three with times as five), 192 MB: a further scan
  /// drops the oldest.
  std::size_t most_waiting_returns = 16000000;
  std::size_t most_poses = 4000;       ///< poses that are remembered: 20 s at 200 Hz
  std::size_t most_returns = 4000000;  ///< of one scan
  double max_gap_s = 0.2;              ///< longest time without poses that is interpolated over, 0.001 .. 10
  /// Pose of the sensor in the frame whose poses are given (an IMU, a body): T_W_S becomes T_W_B * T_B_S.
  std::optional<Eigen::Isometry3d> T_B_S = {};
  /// Returns inside this box, in the sensor's frame, are left out: they are from the platform itself.
  std::optional<Eigen::AlignedBox3d> exclude_box_S = {};
  /// Of scans whose points have times: as in ScanInputOptions. On drops scans without as unusable.
  io::Deskew deskew = io::Deskew::Auto;
  /// How the frame of the poses is tilted: map and labels are in one that is level. From the IMU: by what it felt in
  /// the first second with poses, at rest; scans wait for that.
  std::optional<io::Level> level = {};
  /// Bytes of map, mirror and points (MemoryUse) from which the map no longer grows (AccessibilityField::stopGrowing):
  /// returns for which it has no place are left out, counted, and block; what it has is still updated. 0 = no limit.
  std::uint64_t memory_limit_bytes = 0;
  std::size_t update_every = 1;  ///< scans that are fused before the next labels
  /// The longest that a step should take, 1 .. 60000 ms; 0: however long it takes. So many points are scored as fit, by
  /// how long the steps before took, and others wait, unscored until their turn comes (docs/live.md, "Scans that
  /// come faster than labels"). While no scan is ready, each step() scores some of those that wait. Which budgets were
  /// used is in LiveStep::budget_points: with the same ones, AccessibilityField::setBudgetPoints() gives the same bits.
  double budget_ms = 0;
  /// A map of any extent in bounded memory (RollingField) in place of one field. Its limits are memory_limit_bytes and
  /// device_limit_bytes of these options; notes_changes is always on.
  std::optional<RollingOptions> rolling = {};
  /// Of `rolling`: go on after its last checkpoint. What the IMU of `level` told then still counts.
  bool resume = false;
};

/// The pose of the platform at one time.
struct LivePose {
  std::int64_t stamp_ns = 0;
  Eigen::Vector3d p_W = Eigen::Vector3d::Zero();
  Eigen::Quaterniond q_W_B = Eigen::Quaterniond::Identity();
  /// Name of the world frame, where the sender gives one. The first pose decides; poses in others are not used.
  std::string frame = {};
  /// Name of what is posed, where the sender gives one; as for `frame`. Scans that name another frame are then placed
  /// by transforms between the two (addTransform()), unless LiveOptions::T_B_S says where their sensor is.
  std::string child = {};
};

/// The pose of one frame in another, as tf has them.
struct LiveTransform {
  std::int64_t stamp_ns = 0;
  std::string parent, child;
  Eigen::Vector3d p = Eigen::Vector3d::Zero();
  Eigen::Quaterniond q = Eigen::Quaterniond::Identity();
  bool fixed = false;  ///< at all times (tf_static); the last one counts
};

/// What an IMU measured.
struct LiveImu {
  std::int64_t stamp_ns = 0;
  Eigen::Vector3d force =
      Eigen::Vector3d::Zero();  ///< specific force: up, at rest; m/s2 or g. 1000 and more is not used
  std::string frame =
      {};  ///< of the first one. Transforms that connect it are waited for, for 10 s by the poses' times
};

/// One scan. Its returns are in `points`, or in `points_double` if the sender has doubles.
struct LiveScan {
  std::int64_t stamp_ns = 0;
  std::vector<Eigen::Vector3f> points = {};  ///< exactly (0,0,0) means "no return"
  std::vector<Eigen::Vector3d> points_double = {};
  /// Name of the frame of the points, where the sender gives one. If it is the frame that the poses are in, the points
  /// are in the world already, and the pose only tells where the sensor was; otherwise they are in the sensor's frame.
  std::string frame = {};
  /// When each point was measured, or empty: each is then placed by the pose at its own time, and each ray of points
  /// that are in the world begins where the sensor was. Such a scan waits until there are poses for all of it.
  std::vector<double> times = {};
  /// Of `times`, which then count from stamp_ns: 1, 1e-3, 1e-6 or 1e-9. 0: unit and clock are told from the latest
  /// scans, by the rules of docs/recordings.md, "Motion within a scan".
  double time_unit_s = 0;
};

/// What one step() did.
struct LiveStep {
  std::uint64_t number = 0;  ///< of the scan: how many were published before it
  std::int64_t stamp_ns = 0;
  /// No scan came: points that waited since this last one or earlier ones were scored (LiveOptions::budget_ms,
  /// UpdateParams::budget_points), or labels follow scans that were lost or failed, or are told that such a step did
  /// not.
  bool only_backlog = false;
  /// Of the update of this step, 0: no limit. Nothing if it had none: late, or between those of update_every.
  std::optional<int> budget_points = {};
  FrameStats fused;
  UpdateStats scored;
  std::uint64_t excluded_returns = 0;  ///< inside LiveOptions::exclude_box_S
  std::uint64_t unposed_returns = 0;   ///< left out: no pose at the time at which they were measured
  std::uint64_t left_out_returns = 0;  ///< no place for them, with the memory limit reached
  bool by_times = false;               ///< each return by the pose at its own time
  bool late = false;                   ///< only fused, since too many wait: labels come with a later step
  double waited_ms = 0;                ///< from addScan() to the beginning of the step
  double latency_ms = 0;               ///< from addScan() to labels
  /// Points that are new, or whose label, reason or direction changed, or which of several tools reach them; in
  /// ascending order of their ids. None after a step without labels: late, or between those of
  /// LiveOptions::update_every. Of several steps with only_backlog the last one has those that got their labels, or the
  /// next scan's.
  std::vector<SurfacePoint> changed;
};

/// What removeRegion() did.
struct LiveRemoval {
  Removal removal;
  std::vector<SurfacePoint> changed;  ///< as LiveStep::changed
};

struct DroppedScan {
  std::uint64_t number = 0;  ///< as LiveStep::number
  std::int64_t stamp_ns = 0;
  ScanDrop reason = ScanDrop::QueueFull;
};

struct LiveStatus {
  std::uint64_t published = 0;  ///< scans that were added
  std::uint64_t taken = 0;
  std::uint64_t waiting = 0;  ///< for a pose, for their turn, or for the end of a step
  std::array<std::uint64_t, kNumScanDrops> dropped = {};

  std::uint64_t poses = 0;              ///< that were added
  std::uint64_t poses_invalid = 0;      ///< not finite, not a rotation, or without a usable time: not used
  std::uint64_t poses_repeated = 0;     ///< of a time that was there already: not used
  std::uint64_t poses_backwards = 0;    ///< earlier than the one before
  std::uint64_t poses_other_frame = 0;  ///< in another frame than the first: not used

  std::uint64_t transforms = 0;          ///< that were added
  std::uint64_t transforms_invalid = 0;  ///< not finite, not a rotation, without names: not used
  /// Of frames that were posed in another one before, or of more frames than are kept (1000): not used.
  std::uint64_t transforms_other_parent = 0;

  std::string world_frame = {};        ///< of the first pose
  std::string sensor_chain = {};       ///< by which transforms the last scan was placed: "odom -> body -> lidar"
  std::string unconnected_frame = {};  ///< of the last scan that was dropped since no transform connects its frame
  /// Frame of the IMU, if LiveOptions::level was found as if that were what is posed, since no transform connects it.
  std::string unconnected_imu = {};
  bool waits_for_level = false;  ///< scans wait for LiveOptions::level
  double extrinsic_m = 0;        ///< how far the sensor of the last scan is from what is posed

  std::uint64_t points_in = 0, points_used = 0;  ///< returns of the scans taken
  std::uint64_t late = 0;                        ///< of taken: only fused, since too many waited
  std::uint64_t by_times = 0;                    ///< of taken: each return by the pose at its own time
  std::string motion = {};                       ///< what is done about motion within scans, and why
  std::uint64_t excluded_returns = 0;
  std::uint64_t unposed_returns = 0;
  std::uint64_t left_out_returns = 0;  ///< no memory, or no time: the returns of scans dropped as queue_full, too
  std::uint64_t surface_points = 0;
  /// Of map, mirror and points after the last step. Where a GPU leads, the map may lack up to four scans, but not near
  /// the limit.
  std::uint64_t memory_bytes = 0;
  std::uint64_t memory_limit_bytes = 0;
  bool memory_full = false;                   ///< no new space is taken any more
  std::optional<RollingStatus> rolling = {};  ///< of LiveOptions::rolling, after the last step
  /// So many scans were lost before their poses came that what they saw may be anywhere: nothing is accessible any
  /// more.
  bool all_closed = false;
  bool paused = false;
  std::uint64_t resets = 0;

  double budget_ms = 0;  ///< LiveOptions::budget_ms
  // With that, or UpdateParams::budget_points:
  std::uint64_t budget_points = 0;    ///< most points that the next scan's update scores; 0: all
  std::uint64_t backlog = 0;          ///< points that wait: unscored until their turn comes
  std::uint64_t withheld_points = 0;  ///< UpdateStats::withheld_points
  double backlog_ms = 0;              ///< since the scan came that the oldest of them waits for
  std::uint64_t backlog_max = 0;      ///< the most so far
  double backlog_max_ms = 0;          ///< the longest that a point has waited so far
  std::uint64_t backlog_steps = 0;    ///< LiveStep::only_backlog

  /// From addScan() to labels, over the last 4096 scans taken.
  double latency_p50_ms = 0, latency_p99_ms = 0, latency_max_ms = 0;

  [[nodiscard]] std::uint64_t allDropped() const {
    std::uint64_t sum = 0;
    for (const std::uint64_t count : dropped) sum += count;
    return sum;
  }
};

/// addPose(), addTransform(), addImu(), addScan(), pause(), endOfPoses(), waitForWork(), status() and takeDropped() may
/// be called from any thread at any time; everything else from one thread at a time.
class ACCESSVDB_API LiveSession {
 public:
  /// @throws InvalidArgument "live.queue", "live.poses", "live.window", "live.budget" (also of a rolling map, or beside
  ///         UpdateParams::budget_points), "usage.update_every"; what the constructors of
  ///         AccessibilityField and, of LiveOptions::rolling, RollingField throw, or RollingField::resume();
  ///         UnusableInput "rolling.changed" if that map was made with another LiveOptions::level
  LiveSession(const ToolGeometry& tool, const FieldParams& params = {}, const LiveOptions& options = {});
  /// Several tools over one map, as AccessibilityField. @param progress  of the tools' tables
  explicit LiveSession(std::vector<ToolSpec> tools, const FieldParams& params = {}, const LiveOptions& options = {},
                       const TableProgress& progress = {});
  ~LiveSession();
  LiveSession(LiveSession&&) noexcept;
  LiveSession& operator=(LiveSession&&) noexcept;

  /// Bad poses are counted, never used.
  void addPose(const LivePose& pose);
  /// As in recordings (docs/recordings.md, "Which frame"): a frame keeps its first parent, and what poses say of a
  /// frame takes the place of what transforms say. Bad ones are counted, never used.
  void addTransform(const LiveTransform& transform);
  /// Used for LiveOptions::level, until that is known.
  void addImu(const LiveImu& imu);
  /// Never waits for a step(). Bad scans are counted, never used.
  void addScan(LiveScan scan);
  /// No more poses will come: scans that wait for some are dropped, and once none is left, a step() scores what
  /// LiveOptions::update_every left. A later addPose() takes it back.
  void endOfPoses();

  /// Waits until step() has something to do, also points that wait, at most so long. @return whether it has
  bool waitForWork(std::chrono::milliseconds at_most);
  /// Fuses the oldest scan that has a pose, and scores what it changed. If there is none, scores points that wait, and
  /// lets labels follow what was lost.
  /// @return nothing if no scan is ready, no point waits, and all changes were told
  /// @throws what AccessibilityField::integrateScan() and update() throw, or those of RollingField; that scan then
  ///         counts as failed
  /// @throws UnusableInput "level.no_imu", "level.moving": no scan will have a pose
  std::optional<LiveStep> step();

  /// From now on scans that come are dropped as paused, or taken again. Those that wait keep their turn.
  void pause(bool paused);
  /// The map is forgotten, and points are counted from 0 again. Poses and transforms are kept, scans that wait are
  /// dropped; scans may have earlier times than before. @throws InvalidArgument "live.rolling": not of a rolling map
  void reset();
  /// As AccessibilityField::removeRegion() and update(). @throws InvalidArgument "live.rolling": not of a rolling map
  [[nodiscard]] LiveRemoval removeRegion(const Region& region, RemovedAs as = RemovedAs::Unknown);

  [[nodiscard]] LiveStatus status() const;
  /// The scans dropped since the last call, the last 1024 at most; all are counted in status().
  [[nodiscard]] std::vector<DroppedScan> takeDropped();
  /// As of the last step(). @throws InvalidArgument "live.rolling" of a rolling map
  [[nodiscard]] const AccessibilityField& field() const;
  /// The map of LiveOptions::rolling, for checkpoint(), snapshots and write(); else null. Scans only go in by step().
  [[nodiscard]] RollingField* rolling();
  [[nodiscard]] const FieldParams& params() const;  ///< resolved, for the first tool
  [[nodiscard]] const std::vector<ToolSpec>& tools() const;
  [[nodiscard]] Eigen::Vector3d origin_W() const;  ///< of the local frame of the map
  /// What turns the frame of the poses into that of the map; nothing as long as it is the same, or not known yet.
  [[nodiscard]] std::optional<Eigen::Matrix3d> levelling() const;
  /// Whether the scans agree, of the latest ones that were compared (accessvdb/program/scan_agreement.h).
  [[nodiscard]] io::ScanAgreement agreement() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace accessvdb
