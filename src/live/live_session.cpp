// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "accessvdb/live_session.h"

#include <algorithm>
#include <cmath>
#include <condition_variable>
#include <limits>
#include <mutex>
#include <utility>

#include "accessvdb/error.h"
#include "accessvdb/tool_spec.h"
#include "io/poses/pose_track.h"
#include "io/scans/scan_motion.h"
#include "live/backlog_times.h"
#include "live/latencies.h"
#include "live/live_agreement.h"
#include "live/live_map.h"
#include "live/lost_returns.h"
#include "live/update_budget.h"
#include "live/waiting_scans.h"

namespace accessvdb {
namespace {

using Clock = std::chrono::steady_clock;
using Ready = internal::WaitingScans::Ready;

/// Of the cubes in which lost returns are kept.
constexpr double kLostEdge_voxels = 8;
/// A scan may come while the backlog is worked off, and waits so much of its budget at most.
constexpr double kShareOfBacklog = 0.25;
constexpr int kFirstBudget_points = 2000;

double millisecondsBetween(Clock::time_point from, Clock::time_point to) {
  return std::chrono::duration<double, std::milli>(to - from).count();
}

FieldParams checked(const FieldParams& params, const LiveOptions& options) {
  if (options.queue_scans < 1)
    throw InvalidArgument("live.queue", "queue_scans", "must be 1 or more", "Leave it out for the default");
  if (options.memory_limit_bytes > 0 && params.tsdf.region == UpdateRegion::Projective) {
    throw InvalidArgument("projective.limit", "memory_limit_bytes",
                          "the projective baseline cannot keep a map from growing", "Use another UpdateRegion");
  }
  if (options.update_every < 1)
    throw InvalidArgument("usage.update_every", "update_every", "must be 1 or more", "Leave it out for the default");
  if (options.most_poses < 2)
    throw InvalidArgument("live.poses", "most_poses", "must be 2 or more", "Leave it out for the default");
  if (!(options.max_gap_s >= io::kLeastPoseGap_s && options.max_gap_s <= io::kMostPoseGap_s))
    throw InvalidArgument("usage.max_gap", "max_gap_s", "must be within 0.001 .. 10 seconds", "The default is 0.2");
  if (params.window) throw InvalidArgument("live.window", "window", "is for tiles, not for a live map", "Leave it out");
  if (options.budget_ms != 0) {
    if (!(options.budget_ms >= 1 && options.budget_ms <= 60000))
      throw InvalidArgument("live.budget", "budget_ms", "must be 0 or 1 .. 60000 milliseconds", "Use for example 80");
    if (options.rolling)
      throw InvalidArgument("live.budget", "budget_ms", "is not for a map in tiles, whose points share no budget",
                            "Leave out one of the two");
    if (params.update.budget_points > 0)
      throw InvalidArgument("live.budget", "budget_ms", "takes the place of budget_points", "Leave out one of the two");
  }
  return params;
}

/// Values beyond float become infinite, and are then counted as not finite.
Eigen::Vector3f asFloat(const Eigen::Vector3d& p) {
  constexpr double kMost = std::numeric_limits<float>::max();
  return p
      .unaryExpr(
          [](double v) { return std::abs(v) > kMost ? std::copysign(std::numeric_limits<double>::infinity(), v) : v; })
      .cast<float>();
}

/// Its points, and the pose of the sensor, before anything was left out.
io::ScanRecord recordOf(LiveScan& scan, const Ready& ready) {
  io::ScanRecord record;
  record.T_W_S = ready.motion.T_W_S;
  if (ready.registered) {
    record.points_W = std::move(scan.points_double);
    for (const Eigen::Vector3f& p : scan.points) record.points_W.push_back(p.cast<double>());
    io::moveRegistered(ready.motion.T_W_registered, record.points_W);
  } else {
    record.points_S = std::move(scan.points);
    for (const Eigen::Vector3d& p : scan.points_double) record.points_S.push_back(asFloat(p));
  }
  return record;
}

}  // namespace

struct ACCESSVDB_PRIVATE LiveSession::Impl {
  Impl(std::vector<ToolSpec> tools, const FieldParams& params, const LiveOptions& given, const TableProgress& progress)
      : options(given),
        map(std::move(tools), checked(params, given), given, progress),
        waiting(given, map.params().tsdf.max_range_m, kLostEdge_voxels * map.params().tsdf.voxel_size_m) {
    status.memory_limit_bytes = options.memory_limit_bytes;
    status.budget_ms = options.budget_ms;
    if (options.budget_ms > 0) {
      const int first = kFirstBudget_points;
      clocked = ByClock{.of_scans = {options.budget_ms, first},
                        .of_backlog = {kShareOfBacklog * options.budget_ms, static_cast<int>(kShareOfBacklog * first)}};
    }
    if (options.rolling && options.resume) map.goOnLevel(options.rolling->folder, waiting.poses());
    if (options.rolling) map.tell(status);
  }

  // From the one thread that takes steps, without the lock:

  /// The scan in the world, or with its pose; nothing if its times are not its own.
  [[nodiscard]] std::optional<io::ScanRecord> posed(Ready& ready, LiveStep& step) const {
    LiveScan& scan = ready.waiting.scan;
    io::ScanRecord record = recordOf(scan, ready);
    io::Placed placed = io::Placed::AsIs;
    if (const auto& timed = ready.waiting.timed) {
      const bool insist = options.deskew == io::Deskew::On && !ready.registered;
      placed = io::placeByTimes(
          {scan.times, timed->scale, timed->usual, io::seconds(scan.stamp_ns), ready.registered, insist,
           options.exclude_box_S},
          [&](std::int64_t ms) { return ready.motion.at(ms); }, record);
    }
    if (placed == io::Placed::OtherTimes) return std::nullopt;
    if (placed == io::Placed::AsIs) io::placeAtOnce(ready.registered, options.exclude_box_S, record);
    step.by_times = placed == io::Placed::ByTimes;
    step.excluded_returns = record.excluded_points;
    step.unposed_returns = record.unposed_points;
    return record;
  }

  /// Budgets of updates that follow the clock.
  struct ByClock {
    internal::UpdateBudget of_scans, of_backlog;
  };
  /// What updates left.
  struct Backlog {
    internal::BacklogTimes times = {};
    std::uint64_t points = 0, withheld = 0, most = 0, steps = 0;
    double longest_ms = 0;
    Clock::time_point arrived = {};  ///< the first scan since the last update
  };

  [[nodiscard]] int budgetOfScans() const {
    return clocked ? clocked->of_scans.points() : map.params().update.budget_points;
  }
  [[nodiscard]] int budgetOfBacklog() const { return clocked ? clocked->of_backlog.points() : budgetOfScans(); }

  /// @param budget_points  0: all, however long it takes; a map in tiles has no other
  UpdateStats update(int budget_points) {
    if (map.rolling() == nullptr) map.setBudgetPoints(budget_points);
    const auto oldest = backlog.times.oldest();
    const UpdateStats stats = map.update();
    unscored = 0;
    left_out = false;
    if (oldest) backlog.longest_ms = std::max(backlog.longest_ms, millisecondsBetween(*oldest, Clock::now()));
    backlog.times.note(backlog.arrived, stats.backlog_updates);
    backlog.points = stats.backlog;
    backlog.withheld = stats.withheld_points;
    backlog.most = std::max(backlog.most, stats.backlog);
    return stats;
  }
  UpdateStats update() { return update(budgetOfScans()); }

  /// The last of a step that may throw: what it returns is not told again.
  [[nodiscard]] std::vector<SurfacePoint> takeChanged() {
    std::vector<SurfacePoint> changed = map.takeChanged();
    news = false;
    return changed;
  }

  /// Between two scans, or at the end of them.
  LiveStep workOffBacklog() {
    const Clock::time_point begin = Clock::now();
    LiveStep step;
    step.number = latest_number;
    step.stamp_ns = latest_stamp_ns;
    step.only_backlog = true;
    step.budget_points = budgetOfBacklog();
    step.scored = update(*step.budget_points);
    if (clocked)
      clocked->of_backlog.took(millisecondsBetween(begin, Clock::now()), step.scored.score_ms, backlog.points > 0);
    // What got its label can be told with the next scan, which may come soon. With news more points may wait, and be
    // unscored.
    if (news || backlog.points == 0) step.changed = takeChanged();
    step.latency_ms = millisecondsBetween(begin, Clock::now());
    return step;
  }

  /// Whether there is something to score or to tell without a scan. Between the updates of update_every there is not.
  [[nodiscard]] bool updateIsDue(bool at_end) const {
    const bool between = unscored > 0 && options.update_every > 1;
    return left_out || ((news || backlog.points > 0) && (at_end || !between));
  }
  /// With the lock.
  void tellBacklog() {
    update_is_due = updateIsDue(false);
    status.budget_points = static_cast<std::uint64_t>(budgetOfScans());
    status.backlog = backlog.points;
    status.withheld_points = backlog.withheld;
    status.backlog_max = backlog.most;
    status.backlog_max_ms = backlog.longest_ms;
    status.backlog_steps = backlog.steps;
    oldest_due = backlog.times.oldest();
  }

  /// @param around_W  a position that the map is near to, if there is one: everything is not closed before
  void leaveOut(const internal::LostReturns& returns, const std::optional<Eigen::Vector3d>& around_W) {
    if (returns.empty() && !(owes_all && around_W)) return;
    news = left_out = true;
    const bool all = std::exchange(owes_all, true) || returns.everywhere();
    if (all && !around_W) return;
    if (all) {
      map.leaveOut(std::array<Eigen::Vector3d, 1>{*around_W}, internal::kFarthestReturn_m);
    } else {
      map.leaveOut(returns.centres_W(), std::min(returns.radius_m(), internal::kFarthestReturn_m));
    }
    owes_all = false;
  }

  /// A scan could not be fused: if the field did not break, what it saw is closed, as of one that is dropped.
  void leaveOutReturns(const io::ScanRecord& record, const internal::SensorMotion& motion) {
    internal::LostReturns lost(kLostEdge_voxels * map.params().tsdf.voxel_size_m);
    for (const Eigen::Vector3d& p_W : record.points_W) lost.add(p_W);
    for (const Eigen::Vector3f& p_S : record.points_S)
      if (!p_S.isZero()) lost.add(record.T_W_S * p_S.cast<double>());
    try {
      leaveOut(lost, motion.T_W_S.translation());
      static_cast<void>(update());
      closed = true;
    } catch (const std::exception&) {  // it is broken, and answers nothing
    }
  }

  /// A step failed. If the field did not break, it does not know what the scan saw: everything in its range is closed.
  void leaveOutAround(const internal::SensorMotion& motion) {
    try {
      news = left_out = true;
      const double range_m = map.params().tsdf.max_range_m + motion.spread_m(0);
      map.leaveOut(std::array<Eigen::Vector3d, 1>{motion.T_W_S.translation()},
                   std::min(range_m, internal::kFarthestReturn_m));
      static_cast<void>(update());
    } catch (const std::exception&) {  // it is broken, and answers nothing
    }
  }

  /// @return whether it was taken: its times may not be its own
  bool take(Ready& ready, LiveStep& step) {
    const double stamp_s = io::seconds(ready.waiting.scan.stamp_ns);
    leaveOut(ready.lost, ready.motion.T_W_S.translation());
    const auto record = posed(ready, step);
    if (!record) return false;
    if (!step.late) agreement.add(*record, ready.motion.T_W_B);
    latest_stamp_ns = step.stamp_ns;
    latest_number = step.number;
    if (unscored == 0) backlog.arrived = ready.waiting.arrived;
    try {
      step.fused = map.integrate(*record, stamp_s);
    } catch (...) {
      leaveOutReturns(*record, ready.motion);
      throw;
    }
    step.left_out_returns = step.fused.left_out_returns;
    news = true;
    ++unscored;
    if (step.late || unscored < options.update_every) return true;
    step.budget_points = budgetOfScans();
    step.scored = update();
    return true;
  }

  /// Ends a step with a scan that was taken.
  void tellChanges(LiveStep& step) {
    if (!step.budget_points) return;  // it had no update
    step.changed = takeChanged();
    if (!clocked) return;
    const Clock::time_point now = Clock::now(), oldest = backlog.times.oldest().value_or(now);
    clocked->of_scans.took(millisecondsBetween(step_began, now), step.scored.score_ms, backlog.points > 0,
                           millisecondsBetween(oldest, now));
  }

  const LiveOptions options;
  internal::LiveMap map;
  std::optional<ByClock> clocked = {};  ///< of LiveOptions::budget_ms
  Backlog backlog;
  std::int64_t latest_stamp_ns = 0;  ///< of the latest scan
  std::uint64_t latest_number = 0;
  Clock::time_point step_began = {};
  std::size_t unscored = 0;  ///< scans since the last update
  bool left_out = false;     ///< there are returns without a place since then
  bool news = false;         ///< the map changed since changed points were last looked for
  bool closed = false;       ///< what the scan saw whose step fails
  bool owes_all = false;     ///< returns could not be left out (no memory), and are forgotten: everything has to be
  internal::LiveAgreement agreement{map.params().tsdf.range_noise_m, options.T_B_S};

  mutable std::mutex lock;  ///< for all that follows
  std::condition_variable arrived;
  internal::WaitingScans waiting;
  bool busy = false;  ///< a step has a scan
  bool update_is_due = false;
  std::optional<Clock::time_point> oldest_due = {};  ///< since when the oldest point waits
  LiveStatus status;                                 ///< of what was taken
  internal::Latencies latencies;
  double latency_max_ms = 0;
};

LiveSession::LiveSession(const ToolGeometry& tool, const FieldParams& params, const LiveOptions& options)
    : LiveSession(onlyTool(tool, params), params, options) {}
LiveSession::LiveSession(std::vector<ToolSpec> tools, const FieldParams& params, const LiveOptions& options,
                         const TableProgress& progress)
    : impl_(std::make_unique<Impl>(std::move(tools), params, options, progress)) {}
LiveSession::~LiveSession() = default;
LiveSession::LiveSession(LiveSession&&) noexcept = default;
LiveSession& LiveSession::operator=(LiveSession&&) noexcept = default;

void LiveSession::addPose(const LivePose& pose) {
  {
    const std::scoped_lock locked(impl_->lock);
    impl_->waiting.poses().add(pose);
  }
  impl_->arrived.notify_all();
}

void LiveSession::addTransform(const LiveTransform& transform) {
  {
    const std::scoped_lock locked(impl_->lock);
    impl_->waiting.poses().add(transform);
  }
  impl_->arrived.notify_all();
}

void LiveSession::addImu(const LiveImu& imu) {
  {
    const std::scoped_lock locked(impl_->lock);
    impl_->waiting.poses().add(imu);
  }
  impl_->arrived.notify_all();
}

void LiveSession::addScan(LiveScan scan) {
  {
    const std::scoped_lock locked(impl_->lock);
    impl_->waiting.add(std::move(scan));
  }
  impl_->arrived.notify_all();
}

void LiveSession::endOfPoses() {
  {
    const std::scoped_lock locked(impl_->lock);
    impl_->waiting.poses().end();
  }
  impl_->arrived.notify_all();
}

void LiveSession::pause(bool paused) {
  const std::scoped_lock locked(impl_->lock);
  impl_->waiting.pause(paused);
}

void LiveSession::reset() {
  Impl& impl = *impl_;
  impl.map.reset();
  impl.agreement = internal::LiveAgreement(impl.map.params().tsdf.range_noise_m, impl.options.T_B_S);
  impl.unscored = 0;
  impl.left_out = impl.news = false;
  impl.owes_all = false;
  impl.latest_stamp_ns = 0;
  impl.backlog.times.clear();
  impl.backlog.points = impl.backlog.withheld = 0;
  const std::scoped_lock locked(impl.lock);
  impl.tellBacklog();
  impl.waiting.forgetTaken();
  impl.status.surface_points = 0;
  impl.map.tell(impl.status);
  ++impl.status.resets;
}

LiveRemoval LiveSession::removeRegion(const Region& region, RemovedAs as) {
  LiveRemoval removal;
  removal.removal = impl_->map.field().removeRegion(region, as);
  impl_->news = true;
  static_cast<void>(impl_->update(0));  // everything is asked again: else most of the map would wait, unscored
  removal.changed = impl_->takeChanged();
  const std::scoped_lock locked(impl_->lock);
  impl_->tellBacklog();
  return removal;
}

bool LiveSession::waitForWork(std::chrono::milliseconds at_most) {
  std::unique_lock locked(impl_->lock);
  return impl_->arrived.wait_for(locked, at_most, [this] { return impl_->waiting.hasWork() || impl_->update_is_due; });
}

std::optional<LiveStep> LiveSession::step() {
  for (;;) {
    std::optional<Ready> ready;
    std::optional<internal::LostReturns> lost;
    std::optional<Eigen::Matrix3d> R_L_W;
    bool at_end = false;
    {
      const std::scoped_lock locked(impl_->lock);
      ready = impl_->waiting.next();
      impl_->busy = ready.has_value();
      R_L_W = impl_->waiting.poses().level().R_L_W();
      if (!ready) lost = impl_->waiting.takeLost();
      at_end = impl_->waiting.poses().isEnd() && impl_->waiting.size() == 0;
    }
    if (!ready) {
      std::optional<LiveStep> step;
      try {
        const bool has_map = impl_->latest_stamp_ns != 0;
        impl_->leaveOut(*lost, has_map ? std::optional(impl_->map.origin_W()) : std::nullopt);
        if (has_map && impl_->map.follow(at_end)) impl_->news = true;
        if (impl_->updateIsDue(at_end)) step = impl_->workOffBacklog();
        if (step && !has_map && step->changed.empty()) step.reset();
      } catch (...) {
        const std::scoped_lock locked(impl_->lock);
        impl_->update_is_due = false;  // the next step tries again; nobody is woken for that alone
        throw;
      }
      impl_->backlog.steps += step ? 1 : 0;
      const std::scoped_lock locked(impl_->lock);
      impl_->tellBacklog();
      return step;
    }
    LiveStep step;
    step.number = ready->waiting.number;
    step.stamp_ns = ready->waiting.scan.stamp_ns;
    step.late = ready->late;
    const Clock::time_point arrived = ready->waiting.arrived;
    impl_->step_began = Clock::now();
    step.waited_ms = millisecondsBetween(arrived, impl_->step_began);
    bool taken = false;
    LiveStatus of_map;
    impl_->map.noteLevelling(R_L_W);
    try {
      taken = impl_->take(*ready, step);
      impl_->map.tell(of_map);
      impl_->tellChanges(step);
    } catch (...) {
      if (!std::exchange(impl_->closed, false)) impl_->leaveOutAround(ready->motion);
      const std::scoped_lock locked(impl_->lock);
      impl_->busy = false;
      impl_->tellBacklog();
      impl_->waiting.drop(step.number, step.stamp_ns, ScanDrop::Failed);
      throw;
    }
    step.latency_ms = millisecondsBetween(arrived, Clock::now());
    const std::scoped_lock locked(impl_->lock);
    impl_->busy = false;
    impl_->tellBacklog();
    if (!taken) {
      impl_->waiting.drop(step.number, step.stamp_ns, ScanDrop::Unusable);
      continue;
    }
    LiveStatus& status = impl_->status;
    ++status.taken;
    status.late += step.late ? 1 : 0;
    status.by_times += step.by_times ? 1 : 0;
    status.points_in += step.fused.points_in;
    status.points_used += step.fused.points_used;
    status.excluded_returns += step.excluded_returns;
    status.unposed_returns += step.unposed_returns;
    status.left_out_returns += step.left_out_returns;
    status.surface_points = step.fused.surface_points;
    status.memory_bytes = of_map.memory_bytes;
    status.memory_full = of_map.memory_full;
    status.rolling = std::move(of_map.rolling);
    impl_->latencies.add(step.latency_ms);
    impl_->latency_max_ms = std::max(impl_->latency_max_ms, step.latency_ms);
    return step;
  }
}

io::ScanAgreement LiveSession::agreement() const { return impl_->agreement.latest(); }

LiveStatus LiveSession::status() const {
  const std::scoped_lock locked(impl_->lock);
  LiveStatus status = impl_->status;
  impl_->waiting.tell(status);
  status.waiting += impl_->busy ? 1 : 0;
  status.latency_p50_ms = impl_->latencies.percentile(0.5);
  status.latency_p99_ms = impl_->latencies.percentile(0.99);
  status.latency_max_ms = impl_->latency_max_ms;
  if (impl_->oldest_due) status.backlog_ms = millisecondsBetween(*impl_->oldest_due, Clock::now());
  return status;
}

std::vector<DroppedScan> LiveSession::takeDropped() {
  const std::scoped_lock locked(impl_->lock);
  return impl_->waiting.takeDropped();
}

std::optional<Eigen::Matrix3d> LiveSession::levelling() const {
  const std::scoped_lock locked(impl_->lock);
  return impl_->waiting.poses().level().R_L_W();
}

const AccessibilityField& LiveSession::field() const { return impl_->map.field(); }
RollingField* LiveSession::rolling() { return impl_->map.rolling(); }
const FieldParams& LiveSession::params() const { return impl_->map.params(); }
const std::vector<ToolSpec>& LiveSession::tools() const { return impl_->map.tools(); }
Eigen::Vector3d LiveSession::origin_W() const { return impl_->map.origin_W(); }

}  // namespace accessvdb
