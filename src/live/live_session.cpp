// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "accessvdb/live_session.h"

#include <algorithm>
#include <cmath>
#include <condition_variable>
#include <deque>
#include <limits>
#include <mutex>
#include <utility>

#include "accessvdb/error.h"
#include "accessvdb/surface_points.h"
#include "io/poses/pose_track.h"
#include "io/scans/exclude_box.h"
#include "live/changed_points.h"
#include "live/live_agreement.h"
#include "live/lost_returns.h"
#include "live/pose_buffer.h"

namespace accessvdb {
namespace {

using Clock = std::chrono::steady_clock;

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
  if (options.most_poses < 2)
    throw InvalidArgument("live.poses", "most_poses", "must be 2 or more", "Leave it out for the default");
  if (!(options.max_gap_s >= io::kLeastPoseGap_s && options.max_gap_s <= io::kMostPoseGap_s))
    throw InvalidArgument("usage.max_gap", "max_gap_s", "must be within 0.001 .. 10 seconds", "The default is 0.2");
  if (params.window) throw InvalidArgument("live.window", "window", "is for tiles, not for a live map", "Leave it out");
  return params;
}

std::uint64_t bytesOf(const MemoryUse& use) {
  return use.map_bytes + use.mirror_bytes + use.distance_mirror_bytes + use.point_host_bytes + use.point_device_bytes;
}

/// Values beyond float become infinite, and are then counted as not finite.
Eigen::Vector3f asFloat(const Eigen::Vector3d& p) {
  constexpr double kMost = std::numeric_limits<float>::max();
  return p
      .unaryExpr(
          [](double v) { return std::abs(v) > kMost ? std::copysign(std::numeric_limits<double>::infinity(), v) : v; })
      .cast<float>();
}

std::size_t returnsOf(const LiveScan& scan) { return scan.points.size() + scan.points_double.size(); }
/// What it takes to let a scan wait, in returns: one without any takes memory too.
std::size_t weightOf(const LiveScan& scan) { return std::max<std::size_t>(returnsOf(scan), 100); }

struct WaitingScan {
  LiveScan scan;
  std::uint64_t number = 0;
  Clock::time_point arrived;
};

/// The last latencies, of which percentiles are asked for now and then.
class Latencies {
 public:
  void add(double ms) {
    if (last_.size() < kKept) {
      last_.push_back(ms);
    } else {
      last_[next_] = ms;
    }
    next_ = (next_ + 1) % kKept;
  }
  /// Nearest rank. @param share  in (0, 1]
  [[nodiscard]] double percentile(double share) const {
    if (last_.empty()) return 0;
    std::vector<double> sorted = last_;
    const auto rank = static_cast<std::size_t>(std::ceil(share * static_cast<double>(sorted.size()))) - 1;
    std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(rank), sorted.end());
    return sorted[rank];
  }

 private:
  static constexpr std::size_t kKept = 4096;
  std::vector<double> last_;
  std::size_t next_ = 0;
};

}  // namespace

/// As AccessibilityField::leaveOut() takes it, and farther than any return.
constexpr double kFarthestReturn_m = 1e6;
/// More scans than that are not remembered until their poses come.
constexpr std::size_t kMostUnplaced = 64;
/// After so many scans that were only fused, one is scored in any case.
constexpr int kMostLate = 16;

struct ACCESSVDB_PRIVATE LiveSession::Impl {
  Impl(const ToolGeometry& tool, const FieldParams& params, const LiveOptions& given)
      : options(given),
        field(tool, checked(params, given)),
        lost(lostCube_m()),
        poses(given.most_poses, given.max_gap_s) {
    status.memory_limit_bytes = options.memory_limit_bytes;
  }

  struct Ready {
    WaitingScan waiting;
    Eigen::Isometry3d T_W_B;
    bool registered = false;     ///< its points are in the world frame
    bool late = false;           ///< so many wait behind it that it gets no labels of its own
    internal::LostReturns lost;  ///< since the scan before
  };
  /// A scan as rays, or as points in the sensor's frame with its pose.
  [[nodiscard]] double lostCube_m() const { return 8 * field.params().tsdf.voxel_size_m; }

  // With the lock held:

  void drop(const WaitingScan& scan, ScanDrop reason) {
    constexpr std::size_t kRemembered = std::size_t{1} << 16;
    ++status.dropped[static_cast<std::size_t>(reason)];
    if (dropped.size() == kRemembered) dropped.pop_front();
    dropped.push_back({scan.number, scan.scan.stamp_ns, reason});
  }

  /// There is no time for a scan. If it has a pose, or will have one, what it saw must block.
  void lose(const WaitingScan& waiting) {
    drop(waiting, ScanDrop::QueueFull);
    const LiveScan& scan = waiting.scan;
    const bool registered = isRegistered(scan);
    const auto T_W_B = poses.at(scan.stamp_ns);
    if (!registered && !T_W_B && isHopeless(scan.stamp_ns)) return;
    internal::LostReturns in_sensor(lostCube_m());
    internal::LostReturns& where = registered ? lost : in_sensor;
    const auto add = [&](const Eigen::Vector3d& p) {
      const double range_m = p.norm();
      const double most_m = registered ? kFarthestReturn_m : field.params().tsdf.max_range_m;
      if (range_m > 0 && range_m <= most_m) where.add(p);  // what the field would drop is no return
    };
    for (const Eigen::Vector3f& p : scan.points) add(p.cast<double>());
    for (const Eigen::Vector3d& p : scan.points_double) add(p);
    status.left_out_returns += returnsOf(scan);
    if (registered) return;
    if (T_W_B) {
      place(in_sensor, *T_W_B);
      return;
    }
    if (unplaced.size() == kMostUnplaced) unplaced.pop_front();
    unplaced.emplace_back(scan.stamp_ns, std::move(in_sensor));
  }

  void place(const internal::LostReturns& in_sensor, const Eigen::Isometry3d& T_W_B) {
    const Eigen::Isometry3d T_W_S = options.T_B_S ? T_W_B * *options.T_B_S : T_W_B;
    for (const Eigen::Vector3d& centre_S : in_sensor.centres_W()) lost.add(T_W_S * centre_S, in_sensor.radius_m());
  }

  /// What lost scans saw, as far as their poses are known by now, for the step that follows.
  internal::LostReturns takeLost() {
    std::erase_if(unplaced, [this](const auto& scan) {
      const auto T_W_B = poses.at(scan.first);
      if (T_W_B) place(scan.second, *T_W_B);
      return T_W_B || isHopeless(scan.first);
    });
    return std::exchange(lost, internal::LostReturns(lostCube_m()));
  }

  [[nodiscard]] bool isRegistered(const LiveScan& scan) const {
    return !scan.frame.empty() && world_frame && scan.frame == *world_frame;
  }

  [[nodiscard]] bool isHopeless(std::int64_t stamp_ns) const { return ended || poses.isPast(stamp_ns); }

  [[nodiscard]] bool hasWork() const {
    if (queue.empty()) return false;
    const std::int64_t stamp_ns = queue.front().scan.stamp_ns;
    return isHopeless(stamp_ns) || poses.at(stamp_ns).has_value();
  }

  /// The oldest scan that has a pose, off the queue; those before it that will never have one are dropped.
  std::optional<Ready> next() {
    while (!queue.empty()) {
      const std::int64_t stamp_ns = queue.front().scan.stamp_ns;
      const auto T_W_B = poses.at(stamp_ns);
      if (!T_W_B && !isHopeless(stamp_ns)) return std::nullopt;
      WaitingScan waiting = std::move(queue.front());
      queue.pop_front();
      waiting_returns -= weightOf(waiting.scan);
      if (T_W_B) {
        taken_stamp_ns = stamp_ns;
        internal::LostReturns lost_now = takeLost();
        // Those behind are in order of time: if this one has a pose, all before it have one or never will.
        const bool late = queue.size() >= options.queue_scans &&
                          poses.at(queue[options.queue_scans - 1].scan.stamp_ns).has_value() && lost_now.empty() &&
                          late_in_a_row < kMostLate;
        late_in_a_row = late ? late_in_a_row + 1 : 0;
        const bool registered = isRegistered(waiting.scan);
        return Ready{std::move(waiting), *T_W_B, registered, late, std::move(lost_now)};
      }
      drop(waiting, ScanDrop::NoPose);
    }
    return std::nullopt;
  }

  /// A scan that waits for poses, and is far later than one that comes after it and than the poses, had a wrong clock:
  /// it must not keep out all that follow. The poses judge, because the one that comes may be what is wrong.
  void dropFromTheFuture(std::int64_t stamp_ns) {
    constexpr std::int64_t kFar_ns = 10'000'000'000;
    if (taken_stamp_ns && stamp_ns <= *taken_stamp_ns) return;
    while (!queue.empty() && queue.back().scan.stamp_ns - stamp_ns > kFar_ns &&
           poses.isFarAhead(queue.back().scan.stamp_ns, kFar_ns)) {
      drop(queue.back(), ScanDrop::OutOfOrder);
      waiting_returns -= weightOf(queue.back().scan);
      queue.pop_back();
      last_stamp_ns = queue.empty() ? taken_stamp_ns : queue.back().scan.stamp_ns;
    }
  }

  // Without it, from the one thread that takes steps:

  /// In the world, with one origin, if the scan is registered.
  [[nodiscard]] io::ScanRecord posed(LiveScan scan, const Eigen::Isometry3d& T_W_B, bool registered,
                                     LiveStep& step) const {
    io::ScanRecord out;
    out.T_W_S = options.T_B_S ? T_W_B * *options.T_B_S : T_W_B;
    if (registered) {
      out.points_W = std::move(scan.points_double);
      for (const Eigen::Vector3f& p : scan.points) out.points_W.push_back(p.cast<double>());
      out.origins_W = {out.T_W_S.translation()};
    } else {
      out.points_S = std::move(scan.points);
      for (const Eigen::Vector3d& p : scan.points_double) out.points_S.push_back(asFloat(p));
    }
    if (options.exclude_box_S) {
      step.excluded_returns =
          registered ? io::leaveOutInside(*options.exclude_box_S, out.T_W_S.inverse(Eigen::Isometry), out.points_W)
                     : io::leaveOutInside(*options.exclude_box_S, Eigen::Isometry3d::Identity(), out.points_S);
    }
    return out;
  }

  void leaveOut(const internal::LostReturns& returns) {
    if (!returns.empty()) field.leaveOut(returns.centres_W(), std::min(returns.radius_m(), kFarthestReturn_m));
  }

  /// A step failed. If the field did not break, it does not know what the scan saw: everything in its range is closed.
  void leaveOutAround(const Eigen::Isometry3d& T_W_B) {
    try {
      const double range_m =
          field.params().tsdf.max_range_m + (options.T_B_S ? options.T_B_S->translation().norm() : 0);
      field.leaveOut(std::array<Eigen::Vector3d, 1>{T_W_B.translation()}, std::min(range_m, kFarthestReturn_m));
      static_cast<void>(field.update());
    } catch (const std::exception&) {  // it is broken, and answers nothing
    }
  }

  void take(Ready ready, LiveStep& step) {
    const double stamp_s = 1e-9 * static_cast<double>(ready.waiting.scan.stamp_ns);
    leaveOut(ready.lost);
    const io::ScanRecord scan = posed(std::move(ready.waiting.scan), ready.T_W_B, ready.registered, step);
    if (!step.late) agreement.add(scan, ready.T_W_B);
    if (ready.registered) {
      step.fused = field.integrateRays(scan.points_W, scan.origins_W, stamp_s);
    } else {
      step.fused = field.integrateScan(scan.points_S, scan.T_W_S, stamp_s);
    }
    step.left_out_returns = step.fused.left_out_returns;
    if (step.late) return;
    step.scored = field.update();
    step.changed = changes.since(*field.points());
  }

  void checkMemory(std::uint64_t bytes) {
    if (field.grows() && options.memory_limit_bytes > 0 && bytes > options.memory_limit_bytes) field.stopGrowing();
  }

  const LiveOptions options;
  AccessibilityField field;
  internal::ChangedPoints changes;
  internal::LiveAgreement agreement{field.params().tsdf.range_noise_m, options.T_B_S};

  mutable std::mutex lock;  ///< for all that follows
  std::condition_variable arrived;
  std::deque<WaitingScan> queue;
  std::size_t waiting_returns = 0;  ///< weightOf() all scans in it
  internal::LostReturns lost;       ///< of scans that there was no time for, until the next step
  /// The same of scans whose poses are not there yet: times, and returns in the frame of their sensor.
  std::deque<std::pair<std::int64_t, internal::LostReturns>> unplaced;
  int late_in_a_row = 0;
  std::deque<DroppedScan> dropped;
  internal::PoseBuffer poses;
  std::optional<std::string> world_frame;
  std::optional<std::int64_t> last_stamp_ns;   ///< of the last scan that was put in the queue
  std::optional<std::int64_t> taken_stamp_ns;  ///< of the last one that left it with a pose
  bool ended = false;
  bool busy = false;  ///< a step has a scan
  LiveStatus status;
  Latencies latencies;
  double latency_max_ms = 0;
};

LiveSession::LiveSession(const ToolGeometry& tool, const FieldParams& params, const LiveOptions& options)
    : impl_(std::make_unique<Impl>(tool, params, options)) {}
LiveSession::~LiveSession() = default;
LiveSession::LiveSession(LiveSession&&) noexcept = default;
LiveSession& LiveSession::operator=(LiveSession&&) noexcept = default;

void LiveSession::addPose(const LivePose& pose) {
  {
    const std::scoped_lock locked(impl_->lock);
    ++impl_->status.poses;
    impl_->ended = false;
    if (impl_->world_frame && pose.frame != *impl_->world_frame) {
      ++impl_->status.poses_other_frame;
      return;
    }
    if (impl_->poses.add(pose.stamp_ns, pose.p_W, pose.q_W_B) && !impl_->world_frame) impl_->world_frame = pose.frame;
  }
  impl_->arrived.notify_all();
}

void LiveSession::addScan(LiveScan scan) {
  {
    const std::scoped_lock locked(impl_->lock);
    WaitingScan waiting = {std::move(scan), impl_->status.published++, Clock::now()};
    const std::int64_t stamp_ns = waiting.scan.stamp_ns;
    const bool usable =
        stamp_ns > 0 && stamp_ns <= io::kMostStamp_ns && returnsOf(waiting.scan) <= impl_->options.most_returns;
    if (usable) impl_->dropFromTheFuture(stamp_ns);
    if (!usable) {
      impl_->drop(waiting, ScanDrop::Unusable);
    } else if (impl_->last_stamp_ns && stamp_ns <= *impl_->last_stamp_ns) {
      impl_->drop(waiting, ScanDrop::OutOfOrder);
    } else {
      impl_->last_stamp_ns = stamp_ns;
      const std::size_t weight = weightOf(waiting.scan);
      while (!impl_->queue.empty() && impl_->waiting_returns + weight > impl_->options.most_waiting_returns) {
        impl_->lose(impl_->queue.front());
        impl_->waiting_returns -= weightOf(impl_->queue.front().scan);
        impl_->queue.pop_front();
      }
      impl_->waiting_returns += weight;
      impl_->queue.push_back(std::move(waiting));
    }
  }
  impl_->arrived.notify_all();
}

void LiveSession::endOfPoses() {
  {
    const std::scoped_lock locked(impl_->lock);
    impl_->ended = true;
  }
  impl_->arrived.notify_all();
}

bool LiveSession::waitForWork(std::chrono::milliseconds at_most) {
  std::unique_lock locked(impl_->lock);
  return impl_->arrived.wait_for(locked, at_most, [this] { return impl_->hasWork(); });
}

std::optional<LiveStep> LiveSession::step() {
  std::optional<Impl::Ready> ready;
  {
    const std::scoped_lock locked(impl_->lock);
    ready = impl_->next();
    impl_->busy = ready.has_value();
  }
  if (!ready) {
    internal::LostReturns lost(impl_->lostCube_m());
    {
      const std::scoped_lock locked(impl_->lock);
      lost = impl_->takeLost();
    }
    if (!lost.empty()) {
      impl_->leaveOut(lost);
      static_cast<void>(impl_->field.update());
    }
    return std::nullopt;
  }
  LiveStep step;
  step.number = ready->waiting.number;
  step.stamp_ns = ready->waiting.scan.stamp_ns;
  step.late = ready->late;
  const Clock::time_point arrived = ready->waiting.arrived;
  step.waited_ms = millisecondsBetween(arrived, Clock::now());
  WaitingScan lost;  // what is left of it if the step fails
  lost.number = step.number;
  lost.scan.stamp_ns = step.stamp_ns;
  const Eigen::Isometry3d T_W_B = ready->T_W_B;
  try {
    impl_->take(std::move(*ready), step);
  } catch (...) {
    impl_->leaveOutAround(T_W_B);
    const std::scoped_lock locked(impl_->lock);
    impl_->busy = false;
    impl_->drop(lost, ScanDrop::Failed);
    throw;
  }
  step.latency_ms = millisecondsBetween(arrived, Clock::now());
  const std::uint64_t bytes = bytesOf(impl_->field.memoryUse());
  impl_->checkMemory(bytes);
  const std::scoped_lock locked(impl_->lock);
  LiveStatus& status = impl_->status;
  impl_->busy = false;
  ++status.taken;
  status.late += step.late ? 1 : 0;
  status.points_in += step.fused.points_in;
  status.points_used += step.fused.points_used;
  status.excluded_returns += step.excluded_returns;
  status.left_out_returns += step.left_out_returns;
  status.surface_points = step.fused.surface_points;
  status.memory_bytes = bytes;
  status.memory_full = !impl_->field.grows();
  impl_->latencies.add(step.latency_ms);
  impl_->latency_max_ms = std::max(impl_->latency_max_ms, step.latency_ms);
  return step;
}

io::ScanAgreement LiveSession::agreement() const { return impl_->agreement.latest(); }

LiveStatus LiveSession::status() const {
  const std::scoped_lock locked(impl_->lock);
  LiveStatus status = impl_->status;
  status.waiting = impl_->queue.size() + (impl_->busy ? 1 : 0);
  status.world_frame = impl_->world_frame.value_or("");
  status.poses_invalid = impl_->poses.counts().invalid;
  status.poses_repeated = impl_->poses.counts().repeated;
  status.poses_backwards = impl_->poses.counts().backwards;
  status.latency_p50_ms = impl_->latencies.percentile(0.5);
  status.latency_p99_ms = impl_->latencies.percentile(0.99);
  status.latency_max_ms = impl_->latency_max_ms;
  return status;
}

std::vector<DroppedScan> LiveSession::takeDropped() {
  const std::scoped_lock locked(impl_->lock);
  std::vector<DroppedScan> dropped(impl_->dropped.begin(), impl_->dropped.end());
  impl_->dropped.clear();
  return dropped;
}

const AccessibilityField& LiveSession::field() const { return impl_->field; }

}  // namespace accessvdb
