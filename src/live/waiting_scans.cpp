// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "live/waiting_scans.h"

#include <algorithm>

#include "io/poses/pose_track.h"

namespace accessvdb::internal {
namespace {

/// Of more scans whose poses have not come, only how far they saw is remembered.
constexpr std::size_t kMostDetailed = 64;
/// After more than that, nobody can say any more what they saw: everything is closed.
constexpr std::size_t kMostUnplaced = 4096;
/// After so many scans that were only fused, one is scored in any case.
constexpr int kMostLate = 16;

std::size_t returnsOf(const LiveScan& scan) { return scan.points.size() + scan.points_double.size(); }
/// What it takes to let a scan wait, in returns of 12 bytes: one without any takes memory too.
std::size_t weightOf(const LiveScan& scan) {
  return std::max<std::size_t>(returnsOf(scan) + (2 * scan.times.size() + 2) / 3, 100);
}

bool isUsable(const LiveScan& scan, const LiveOptions& options) {
  constexpr double kUnits_s[] = {0, 1, 1e-3, 1e-6, 1e-9};
  return scan.stamp_ns > 0 && scan.stamp_ns <= io::kMostStamp_ns && returnsOf(scan) <= options.most_returns &&
         (scan.times.empty() || scan.times.size() == returnsOf(scan)) &&
         std::find(std::begin(kUnits_s), std::end(kUnits_s), scan.time_unit_s) != std::end(kUnits_s);
}

}  // namespace

void WaitingScans::drop(std::uint64_t number, std::int64_t stamp_ns, ScanDrop reason) {
  constexpr std::size_t kRemembered = std::size_t{1} << 16;
  ++drops_[static_cast<std::size_t>(reason)];
  if (dropped_.size() == kRemembered) dropped_.pop_front();
  dropped_.push_back({number, stamp_ns, reason});
}

void WaitingScans::add(LiveScan scan) {
  scan.frame = io::plainFrame(scan.frame);
  WaitingScan waiting = {std::move(scan), published_++, std::chrono::steady_clock::now()};
  const std::int64_t stamp_ns = waiting.scan.stamp_ns;
  if (paused_) return drop(waiting, ScanDrop::Paused);
  if (!isUsable(waiting.scan, options_)) return drop(waiting, ScanDrop::Unusable);
  dropFromTheFuture(stamp_ns);
  if (last_stamp_ns_ && stamp_ns <= *last_stamp_ns_) return drop(waiting, ScanDrop::OutOfOrder);
  const ScanTimes::Verdict verdict = times_.next(waiting.scan, poses_.isRegistered(waiting.scan.frame));
  if (verdict.use == ScanTimes::Use::None) return drop(waiting, ScanDrop::Unusable);
  waiting.timed = verdict.timed;
  if (!waiting.timed) waiting.scan.times = {};
  last_stamp_ns_ = stamp_ns;
  const std::size_t weight = weightOf(waiting.scan);
  while (!queue_.empty() && waiting_returns_ + weight > options_.most_waiting_returns) {
    lose(queue_.front());
    removeFirst();
  }
  waiting_returns_ += weight;
  queue_.push_back(std::move(waiting));
}

void WaitingScans::forgetTaken() {
  for (const WaitingScan& waiting : queue_) drop(waiting, ScanDrop::Reset);
  queue_.clear();
  waiting_returns_ = 0;
  taken_stamp_ns_.reset();
  last_stamp_ns_.reset();
  lost_ = LostReturns(cube_m_);
  unplaced_.clear();
  all_lost_ = false;
}

void WaitingScans::removeFirst() {
  waiting_returns_ -= weightOf(queue_.front().scan);
  queue_.pop_front();
}

/// At which its returns were measured, and between which it needs poses.
std::optional<io::WholeMilliseconds> WaitingScans::millisecondsOf(const WaitingScan& waiting) const {
  if (!waiting.timed) return std::nullopt;
  return io::around(waiting.timed->range);
}

bool WaitingScans::isSettled(const WaitingScan& waiting) const {
  const std::string& frame = waiting.scan.frame;
  const std::int64_t stamp_ns = waiting.scan.stamp_ns;
  if (!poses_.isSettled(frame, stamp_ns)) return false;
  if (!waiting.timed || !poses_.motionAt(frame, stamp_ns)) return true;
  // A few returns with wild times do not keep the others waiting.
  const io::OffsetRange used = {waiting.timed->range.first_s,
                                std::min(waiting.timed->range.last_s, waiting.timed->usual.last_s)};
  return poses_.isSettled(frame, stamp_ns + io::around(used).last * 1'000'000);
}

bool WaitingScans::isReady(const WaitingScan& waiting) const {
  return isSettled(waiting) && poses_.motionAt(waiting.scan.frame, waiting.scan.stamp_ns);
}

std::optional<WaitingScans::Ready> WaitingScans::next() {
  if (!queue_.empty() && poses_.levelIsDue()) poses_.findLevel();
  while (hasWork()) {
    WaitingScan waiting = std::move(queue_.front());
    waiting_returns_ -= weightOf(waiting.scan);
    queue_.pop_front();
    auto motion = poses_.motionAt(waiting.scan.frame, waiting.scan.stamp_ns, millisecondsOf(waiting));
    if (!motion) {
      poses_.noteDropped(waiting.scan.frame);
      drop(waiting, ScanDrop::NoPose);
      continue;
    }
    poses_.noteTaken(waiting.scan.frame, *motion);
    taken_stamp_ns_ = waiting.scan.stamp_ns;
    LostReturns lost_now = takeLost();
    // Those behind are in order of time: if this one has a pose, all before it have one or never will.
    const bool late = queue_.size() >= options_.queue_scans && isReady(queue_[options_.queue_scans - 1]) &&
                      lost_now.empty() && late_in_a_row_ < kMostLate;
    late_in_a_row_ = late ? late_in_a_row_ + 1 : 0;
    if (all_lost_) lost_now.addEverywhere();  // the field closes what is near enough to the sensor
    const bool registered = poses_.isRegistered(waiting.scan.frame);
    return Ready{std::move(waiting), std::move(*motion), registered, late, std::move(lost_now)};
  }
  return std::nullopt;
}

/// There is no time for a scan. If it has a pose, or will have one, what it saw must block.
void WaitingScans::lose(const WaitingScan& waiting) {
  drop(waiting, ScanDrop::QueueFull);
  const LiveScan& scan = waiting.scan;
  const bool registered = poses_.isRegistered(scan.frame);
  // Registered returns need no pose, unless they have to be turned level.
  const bool placed = registered && poses_.level().isKnown() && !poses_.level().R_L_W();
  if (!placed && poses_.isHopeless(scan.frame, scan.stamp_ns)) return;
  Unplaced unplaced = {scan.frame, scan.stamp_ns, millisecondsOf(waiting), registered, 0, LostReturns(cube_m_)};
  LostReturns& where = placed ? lost_ : unplaced.returns;
  const auto add = [&](const Eigen::Vector3d& p) {
    const double range_m = p.norm();
    const double most_m = registered ? kFarthestReturn_m : max_range_m_;
    if (!(range_m > 0 && range_m <= most_m)) return;  // what the field would drop is no return
    where.add(p);
    unplaced.farthest_m = std::max(unplaced.farthest_m, range_m);
  };
  for (const Eigen::Vector3f& p : scan.points) add(p.cast<double>());
  for (const Eigen::Vector3d& p : scan.points_double) add(p);
  left_out_returns_ += returnsOf(scan);
  if (placed) return;
  if (isReady(waiting)) {
    place(unplaced, *poses_.motionAt(unplaced.frame, unplaced.stamp_ns, unplaced.ms));
    return;
  }
  remember(std::move(unplaced));
}

void WaitingScans::remember(Unplaced scan) {
  if (scan.returns.empty() || all_lost_) return;
  if (unplaced_.size() == kMostUnplaced) {
    unplaced_.clear();
    all_lost_ = true;
    lost_.addEverywhere();
    return;
  }
  unplaced_.push_back(std::move(scan));
  if (unplaced_.size() <= kMostDetailed) return;
  Unplaced& older = unplaced_[unplaced_.size() - kMostDetailed - 1];  // those before it are balls already
  older.returns = LostReturns(cube_m_);
  older.returns.add(Eigen::Vector3d::Zero(), older.farthest_m);
}

/// Where the sensor was when each was measured is not kept: they may lie as far apart as it moved within the scan.
void WaitingScans::place(const Unplaced& scan, const SensorMotion& motion) {
  const Eigen::Isometry3d& T_W = scan.registered ? motion.T_W_registered : motion.T_W_S;
  const double spread_m = scan.returns.radius_m() + (scan.registered ? 0 : motion.spread_m(scan.farthest_m));
  for (const Eigen::Vector3d& centre : scan.returns.centres_W()) lost_.add(T_W * centre, spread_m);
}

LostReturns WaitingScans::takeLost() {
  std::erase_if(unplaced_, [this](const Unplaced& scan) {
    const std::int64_t last_ns = scan.stamp_ns + (scan.ms ? scan.ms->last * 1'000'000 : 0);
    const bool settled = poses_.isSettled(scan.frame, scan.stamp_ns) && poses_.isSettled(scan.frame, last_ns);
    if (!settled && !poses_.isHopeless(scan.frame, scan.stamp_ns)) return false;
    const auto motion = poses_.motionAt(scan.frame, scan.stamp_ns, scan.ms);
    if (motion) place(scan, *motion);
    return true;
  });
  return std::exchange(lost_, LostReturns(cube_m_));
}

/// A scan that waits for poses, and is far later than one that comes after it and than the poses, had a wrong clock:
/// it must not keep out all that follow. The poses judge, because the one that comes may be what is wrong.
void WaitingScans::dropFromTheFuture(std::int64_t stamp_ns) {
  constexpr std::int64_t kFar_ns = 10'000'000'000;
  if (taken_stamp_ns_ && stamp_ns <= *taken_stamp_ns_) return;
  while (!queue_.empty() && queue_.back().scan.stamp_ns - stamp_ns > kFar_ns &&
         poses_.isFarAhead(queue_.back().scan.stamp_ns, kFar_ns)) {
    drop(queue_.back(), ScanDrop::OutOfOrder);
    waiting_returns_ -= weightOf(queue_.back().scan);
    queue_.pop_back();
    last_stamp_ns_ = queue_.empty() ? taken_stamp_ns_ : queue_.back().scan.stamp_ns;
  }
}

std::vector<DroppedScan> WaitingScans::takeDropped() {
  std::vector<DroppedScan> dropped(dropped_.begin(), dropped_.end());
  dropped_.clear();
  return dropped;
}

void WaitingScans::tell(LiveStatus& status) const {
  poses_.tell(status);
  status.published = published_;
  status.waiting = queue_.size();
  status.dropped = drops_;
  status.paused = paused_;
  status.all_closed = all_lost_;
  status.left_out_returns += left_out_returns_;
  status.motion = times_.words();
}

}  // namespace accessvdb::internal
