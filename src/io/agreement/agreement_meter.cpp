// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <iterator>

#include "accessvdb/program/scan_agreement.h"
#include "io/agreement/level_surfaces.h"
#include "io/agreement/pose_changes.h"
#include "io/agreement/scan_view.h"
#include "io/median.h"
#include "io/streams/input_file.h"

namespace accessvdb::io {
namespace {

constexpr std::size_t kReturnsKept = 20'000;  ///< of a scan, for its view
constexpr std::size_t kReturnsAsked = 128;    ///< of a scan, in each other scan
constexpr std::size_t kReturnsTried = 32;     ///< the same for each change of the poses
constexpr std::size_t kLeastReturns = 20;     ///< a scan with fewer says nothing
/// Scans that are farther apart than this share of their range see other places, or the same ones from too far.
constexpr double kNearShare = 0.75;
/// With fewer answers, surface or free, chance decides.
constexpr std::uint64_t kLeastAnswers = 100;

// What was measured of right and wrong poses is in docs/evaluation.md, "Agreement of scans".
constexpr double kDoubtfulGain = 0.03, kDisagreeGain = 0.12;  ///< of the score, by a change of the poses
/// Without a change that helps. Things that move, leaves and thin bars contradict, too.
constexpr double kDoubtfulShare = 0.7, kDisagreeShare = 0.5;
constexpr double kSureShare = 0.75, kSureScore = 0.9;  ///< to refuse: many contradict, or the change explains all
constexpr double kSureGain = 0.2;                      ///< to refuse what is not contradicted

/// From here on nothing contradicts the poses: a change has to explain nearly all, and gain more where there are few
/// scans. A few that see an object from all around share little.
constexpr double kUncontradicted = 0.95, kExplainsAll = 0.9;
constexpr std::size_t kLeastUncontradicted = 8, kManyScans = 12;
constexpr double kLeastGainOfFew = 0.2, kLeastGainOfMany = 0.08;

/// Changes that put all sensors near each other make all scans of a long wall alike. They have to gain more, and are
/// tried only where something speaks against the poses: returns that contradict or are hidden, scans that have nothing
/// in common, or another change that gains.
constexpr double kCollapseGain = 0.3, kSpokenAgainst = 0.25, kContradictedShare = 0.96, kNothingInCommon = 0.1,
                 kHint = 0.1;

constexpr std::size_t kLeastForTimes = 6;  ///< scans: of two or three, another time only puts them into one place
constexpr double kTimeShare = 0.02;        ///< by which a time offset has to raise the share
constexpr double kPosedShare = 0.75;       ///< of the pairs, after a change

/// Outliers are looked for among so many scans, and at most one in so many is one.
constexpr std::size_t kLeastForOutliers = 4, kMostOutliers = 4;
constexpr double kOutlierShare = 0.85, kOthersShare = 0.95, kOutlierGap = 0.1;

/// Patches of a twentieth of the range have a few returns, and are small beside rooms and trees.
constexpr double kPatchShare = 0.05;

/// Rays without a return are at the sensor, in clouds in the world frame too.
constexpr float kNoReturn_m = 0.01F;

struct Scan {
  std::vector<Eigen::Vector3f> returns_S;  ///< relative to the sensor
  Eigen::Isometry3d T_W_S;
  AgreementMeter::PoseAt pose_at;
  double median_range_m = 0;
  std::string name;
  std::unique_ptr<ScanView> view;
};

struct Pair {
  std::size_t from, to;
  AgreementCounts now = {};  ///< with the poses as they are
  [[nodiscard]] bool has(std::size_t scan) const { return from == scan || to == scan; }
};

/// A change, and what the same returns say of the poses as they are.
struct Tried {
  PoseCure change;
  AgreementCounts before;
  [[nodiscard]] double gain() const { return change.counts.score() - before.score(); }
};

template <typename Keep>
AgreementCounts sumOf(const std::vector<Pair>& pairs, const Keep& keep) {
  AgreementCounts sum;
  for (const Pair& pair : pairs)
    if (keep(pair)) sum += pair.now;
  return sum;
}
AgreementCounts sumOf(const std::vector<Pair>& pairs) {
  return sumOf(pairs, [](const Pair&) { return true; });
}

void note(ScanView::Answer answer, AgreementCounts& counts) {
  switch (answer) {
    case ScanView::Answer::Surface:
      ++counts.agreeing;
      break;
    case ScanView::Answer::Free:
      ++counts.contradicting;
      break;
    case ScanView::Answer::Hidden:
      ++counts.hidden;
      break;
    case ScanView::Answer::Nothing:
      ++counts.beside;
      break;
    case ScanView::Answer::Unknown:
      break;
  }
}

double medianRangeOf_m(const std::vector<Eigen::Vector3f>& points) {
  std::vector<double> ranges_m;
  ranges_m.reserve(points.size());
  for (const Eigen::Vector3f& p : points) ranges_m.push_back(p.norm());
  return ranges_m.empty() ? 0 : median(std::move(ranges_m));
}

/// Every n-th of them, so that at most `most` are left; spread over all.
std::size_t strideFor(std::size_t count, std::size_t most) {
  return std::max<std::size_t>(1, (count + most - 1) / most);
}

/// Up to kReturnsKept returns, relative to where they were seen from.
/// @param T_W_S  of the scan, or of the first ray
std::vector<Eigen::Vector3f> returnsOf(const ScanRecord& record, const Eigen::Isometry3d& T_W_S) {
  const bool in_sensor = record.points_W.empty();
  const std::size_t count = in_sensor ? record.points_S.size() : record.points_W.size();
  const Eigen::Isometry3d T_S_W = T_W_S.inverse();
  std::vector<Eigen::Vector3f> returns;
  for (std::size_t i = 0, stride = strideFor(count, kReturnsKept); i < count; i += stride) {
    if (record.deskewed && record.points_W[i] == record.origins_W[i]) continue;
    const Eigen::Vector3f p_S = in_sensor ? record.points_S[i] : (T_S_W * record.points_W[i]).cast<float>().eval();
    if (p_S.allFinite() && !p_S.isZero(0)) returns.push_back(p_S);
  }
  return returns;
}

std::string nameOf(const ScanRecord& record) {
  const std::filesystem::path path = record.path;
  const std::string extension = path.extension().string();
  std::string name = forMessage(path.filename().native());
  if (record.stamp_s != 0 && (extension == ".mcap" || extension == ".bag" || extension == ".db3")) {
    char at[64];
    std::snprintf(at, sizeof at, " at %.3f s", record.stamp_s);
    name += at;
  }
  return name;
}

bool collapses(const PoseCure& change) {
  return change.fault == PoseFault::InWorld || (change.fault == PoseFault::Unit && change.value < 1);
}

}  // namespace

struct ACCESSVDB_PRIVATE AgreementMeter::Impl {
  float three_sigma_m = 0;
  Eigen::Isometry3d T_B_S = Eigen::Isometry3d::Identity();
  bool extrinsic = false;
  std::vector<Scan> scans;
  std::size_t in_world = 0;  ///< clouds that cannot be compared
  std::vector<Eigen::Vector3f> normals_W;

  void addPatches(const std::vector<Eigen::Vector3f>& points, const Eigen::Matrix3f& R_W) {
    std::vector<Eigen::Vector3f> normals;
    appendPatchNormals(points, static_cast<float>(kPatchShare * medianRangeOf_m(points)), normals);
    for (const Eigen::Vector3f& normal : normals) normals_W.push_back(R_W * normal);
  }

  void makeViews() {
    tbb::parallel_for(std::size_t{0}, scans.size(), [&](std::size_t i) {
      if (!scans[i].view) scans[i].view = std::make_unique<ScanView>(scans[i].returns_S);
    });
  }

  [[nodiscard]] std::vector<Pair> nearPairs() const {
    std::vector<Pair> pairs;
    for (std::size_t i = 0; i < scans.size(); ++i) {
      for (std::size_t j = 0; j < scans.size(); ++j) {
        if (i == j) continue;
        const double apart_m = (scans[i].T_W_S.translation() - scans[j].T_W_S.translation()).norm();
        if (apart_m <= kNearShare * std::max(scans[i].median_range_m, scans[j].median_range_m)) pairs.push_back({i, j});
      }
    }
    return pairs;
  }
  [[nodiscard]] std::vector<Pair> followingPairs() const {
    std::vector<Pair> pairs;
    for (std::size_t i = 0; i + 1 < scans.size(); ++i) {
      pairs.push_back({i, i + 1});
      pairs.push_back({i + 1, i});
    }
    return pairs;
  }

  /// What the returns of all pairs get for an answer. Integer sums, so the order of the pairs does not matter.
  /// @param answers  of a pair: what a return of its first scan gets in its second
  template <typename Answers>
  [[nodiscard]] AgreementCounts count(const std::vector<Pair>& pairs, std::size_t asked, const Answers& answers) const {
    return tbb::parallel_reduce(
        tbb::blocked_range<std::size_t>(0, pairs.size(), 4), AgreementCounts{},
        [&](const tbb::blocked_range<std::size_t>& range, AgreementCounts counts) {
          for (std::size_t n = range.begin(); n < range.end(); ++n) counts += countOf(pairs[n], asked, answers);
          return counts;
        },
        [](AgreementCounts a, const AgreementCounts& b) { return a += b; });
  }
  template <typename Answers>
  [[nodiscard]] AgreementCounts countOf(const Pair& pair, std::size_t asked, const Answers& answers) const {
    const auto answer = answers(pair);
    const auto& returns_S = scans[pair.from].returns_S;
    AgreementCounts counts;
    for (std::size_t k = 0, stride = strideFor(returns_S.size(), asked); k < returns_S.size(); k += stride)
      note(answer(returns_S[k]), counts);
    return counts;
  }

  [[nodiscard]] auto answersWith(const std::vector<Eigen::Isometry3d>& T_W_S) const {
    return [this, &T_W_S](const Pair& pair) {
      return [this, &view = *scans[pair.to].view,
              T = Eigen::Isometry3f((T_W_S[pair.to].inverse() * T_W_S[pair.from]).cast<float>())](
                 const Eigen::Vector3f& p_S) { return view.at(T * p_S, three_sigma_m); };
    };
  }

  [[nodiscard]] std::vector<Eigen::Isometry3d> posesAsTheyAre() const {
    std::vector<Eigen::Isometry3d> poses;
    for (const Scan& scan : scans) poses.push_back(scan.T_W_S);
    return poses;
  }

  void compare(std::vector<Pair>& pairs) const {
    const std::vector<Eigen::Isometry3d> poses = posesAsTheyAre();
    tbb::parallel_for(std::size_t{0}, pairs.size(),
                      [&](std::size_t n) { pairs[n].now = countOf(pairs[n], kReturnsAsked, answersWith(poses)); });
  }

  /// Nothing for a scan that has no pose then.
  [[nodiscard]] std::vector<std::optional<Eigen::Isometry3d>> changed(const PoseCure& change) const {
    std::vector<std::optional<Eigen::Isometry3d>> poses;
    for (const Scan& scan : scans) {
      const auto T_W_B = scan.pose_at(change.fault == PoseFault::TimeOffset ? change.value : 0);
      poses.push_back(T_W_B ? std::optional(changedPose(change, *T_W_B, T_B_S)) : std::nullopt);
    }
    return poses;
  }

  /// The pairs whose scans both have a pose after the change, before and after it.
  /// @param before  of all pairs
  [[nodiscard]] std::optional<Tried> tried(PoseCure change, const std::vector<Pair>& pairs,
                                           const AgreementCounts& before) const {
    const auto poses = changed(change);
    std::vector<Eigen::Isometry3d> known;
    for (const auto& pose : poses) known.push_back(pose.value_or(Eigen::Isometry3d::Identity()));
    std::vector<Pair> both;
    for (const Pair& pair : pairs)
      if (poses[pair.from] && poses[pair.to]) both.push_back(pair);
    if (static_cast<double>(both.size()) < kPosedShare * static_cast<double>(pairs.size())) return std::nullopt;
    change.counts = count(both, kReturnsTried, answersWith(known));
    if (both.size() == pairs.size()) return Tried{change, before};
    return Tried{change, count(both, kReturnsTried, answersWith(posesAsTheyAre()))};
  }

  /// Scans that do not agree with the others, where those do; their pairs are taken out.
  [[nodiscard]] std::vector<std::size_t> takeOutliers(std::vector<Pair>& pairs) const {
    std::vector<std::size_t> outliers;
    if (scans.size() < kLeastForOutliers) return outliers;
    std::vector<std::size_t> alone;  // far from all others, which are near each other
    for (std::size_t i = 0; i < scans.size(); ++i)
      if (std::none_of(pairs.begin(), pairs.end(), [i](const Pair& pair) { return pair.has(i); })) alone.push_back(i);
    if (scans.size() >= 2 * kLeastForOutliers && kMostOutliers * alone.size() <= scans.size()) outliers = alone;
    while (kMostOutliers * (outliers.size() + 1) <= scans.size()) {
      std::optional<std::size_t> worst;
      double worst_share = kOutlierShare;
      for (std::size_t i = 0; i < scans.size(); ++i) {
        const AgreementCounts of_scan = sumOf(pairs, [i](const Pair& pair) { return pair.has(i); });
        if (of_scan.agreeing + of_scan.contradicting < kLeastAnswers || of_scan.share() >= worst_share) continue;
        worst_share = of_scan.share();
        worst = i;
      }
      if (!worst) break;
      const AgreementCounts left = sumOf(pairs, [&](const Pair& pair) { return !pair.has(*worst); });
      if (left.agreeing + left.contradicting < kLeastAnswers ||
          left.share() < std::max(kOthersShare, worst_share + kOutlierGap))
        break;
      outliers.push_back(*worst);
      std::erase_if(pairs, [&](const Pair& pair) { return pair.has(*worst); });
    }
    return outliers;
  }

  /// In the world frame, returns are not much farther from their sensors than from the origin. Seen from afar
  /// everything looks alike.
  [[nodiscard]] bool canBeInWorld() const {
    return std::all_of(scans.begin(), scans.end(),
                       [](const Scan& scan) { return medianRangeOf_m(fromSensor(scan)) <= 3 * scan.median_range_m; });
  }

  /// Returns in the world frame, relative to the sensor.
  static std::vector<Eigen::Vector3f> fromSensor(const Scan& scan) {
    const Eigen::Vector3f sensor_W = scan.T_W_S.translation().cast<float>();
    std::vector<Eigen::Vector3f> returns;
    for (const Eigen::Vector3f& p_W : scan.returns_S) returns.push_back(p_W - sensor_W);
    return returns;
  }

  /// As if the returns were in the world frame already, seen from the sensors.
  [[nodiscard]] AgreementCounts countInWorld(const std::vector<Pair>& pairs) const {
    std::vector<std::unique_ptr<ScanView>> views(scans.size());
    tbb::parallel_for(std::size_t{0}, scans.size(), [&](std::size_t i) {
      std::vector<Eigen::Vector3f> returns = fromSensor(scans[i]);
      std::erase_if(returns, [](const Eigen::Vector3f& p) { return p.norm() <= kNoReturn_m; });
      views[i] = std::make_unique<ScanView>(returns);
    });
    return count(pairs, kReturnsTried, [&](const Pair& pair) {
      return [this, &view = *views[pair.to], from_W = scans[pair.from].T_W_S.translation().cast<float>().eval(),
              to_W = scans[pair.to].T_W_S.translation().cast<float>().eval()](const Eigen::Vector3f& p_W) {
        if ((p_W - from_W).norm() <= kNoReturn_m) return ScanView::Answer::Unknown;
        return view.at(p_W - to_W, three_sigma_m);
      };
    });
  }

  /// The change with which the scans agree best.
  [[nodiscard]] std::optional<Tried> bestChange(const std::vector<Pair>& pairs, const AgreementCounts& now,
                                                bool far_apart) const {
    if (std::any_of(scans.begin(), scans.end(), [](const Scan& scan) { return !scan.pose_at; })) return std::nullopt;
    const auto against = static_cast<double>(now.contradicting + now.hidden);
    const auto agreeing = static_cast<double>(now.agreeing);
    const bool nothing_in_common = agreeing < kNothingInCommon * static_cast<double>(now.asked());
    const bool few = scans.size() < kLeastForTimes;
    const AgreementCounts before = count(pairs, kReturnsTried, answersWith(posesAsTheyAre()));
    std::optional<Tried> best;
    const auto offer = [&](const std::optional<Tried>& one) {
      if (!one || (best && one->gain() <= best->gain())) return;
      const PoseCure& change = one->change;
      if (change.fault == PoseFault::TimeOffset &&
          (few || nothing_in_common || change.counts.share() < one->before.share() + kTimeShare))
        return;
      // Scans that see different things agree with nothing, and few of them do so by rights. A change that is to speak
      // against poses that nothing contradicts has to explain nearly all.
      if (now.share() >= kUncontradicted) {
        const double least_gain = scans.size() < kManyScans ? kLeastGainOfFew : kLeastGainOfMany;
        if (scans.size() < kLeastUncontradicted || change.counts.score() < kExplainsAll || one->gain() < least_gain)
          return;
      }
      best = one;
    };
    bool doubtful = false;
    const std::vector<PoseCure> changes = poseChanges();
    for (const PoseCure& change : changes) {
      if (change.fault == PoseFault::InverseExtrinsic && !extrinsic) continue;
      if (collapses(change)) continue;
      const auto one = tried(change, pairs, before);
      doubtful = doubtful || (one && change.fault != PoseFault::TimeOffset && one->gain() >= kHint);
      offer(one);
    }
    if (!doubtful && !nothing_in_common && now.share() >= kContradictedShare &&
        against <= kSpokenAgainst * (agreeing + against))
      return best;
    for (const PoseCure& change : changes)
      if (collapses(change)) offer(tried(change, pairs, before));
    if (far_apart || !canBeInWorld()) return best;
    Tried moved = {{PoseFault::InWorld}, before};
    moved.change.counts = countInWorld(pairs);
    offer(moved);
    return best;
  }
};

AgreementMeter::AgreementMeter(double range_noise_m, const std::optional<Eigen::Isometry3d>& T_B_S)
    : impl_(std::make_unique<Impl>()) {
  impl_->three_sigma_m = static_cast<float>(3 * range_noise_m);
  impl_->extrinsic = T_B_S.has_value();
  if (T_B_S) impl_->T_B_S = *T_B_S;
}
AgreementMeter::~AgreementMeter() = default;
AgreementMeter::AgreementMeter(AgreementMeter&&) noexcept = default;
AgreementMeter& AgreementMeter::operator=(AgreementMeter&&) noexcept = default;

std::size_t AgreementMeter::size() const { return impl_->scans.size(); }

double AgreementMeter::medianRange_m() const { return impl_->scans.empty() ? 0 : impl_->scans.back().median_range_m; }

std::optional<Eigen::Vector3d> AgreementMeter::upBesideZ_W() const { return upBesideZ(impl_->normals_W); }

void AgreementMeter::add(const ScanRecord& record, const PoseAt& pose_at) {
  const bool in_world = !record.points_W.empty() && !record.deskewed;
  const bool many_places = in_world && record.origins_W.size() > 1;
  Scan scan;
  scan.T_W_S = in_world ? Eigen::Isometry3d(Eigen::Translation3d(record.origins_W[0])) : record.T_W_S;
  scan.returns_S = returnsOf(record, scan.T_W_S);
  impl_->addPatches(scan.returns_S, scan.T_W_S.linear().cast<float>());
  if (many_places) {
    ++impl_->in_world;
    return;
  }
  // The parts of one scanner's cloud are one scan.
  for (Scan& known : impl_->scans) {
    if (!in_world || known.pose_at || known.T_W_S.translation() != scan.T_W_S.translation()) continue;
    known.returns_S.insert(known.returns_S.end(), scan.returns_S.begin(), scan.returns_S.end());
    return;
  }
  if (scan.returns_S.size() < kLeastReturns || !scan.T_W_S.matrix().allFinite()) return;
  if (!in_world) scan.pose_at = pose_at;
  scan.name = nameOf(record);
  scan.median_range_m = medianRangeOf_m(scan.returns_S);
  impl_->scans.push_back(std::move(scan));
}

ScanAgreement AgreementMeter::measure() const {
  ScanAgreement result;
  result.scans = impl_->scans.size();
  if (result.scans < 2) {
    result.why_not = result.scans == 1     ? "a single scan"
                     : impl_->in_world > 0 ? "clouds in the world frame"
                                           : "the scans have too few returns";
    return result;
  }
  impl_->makeViews();
  std::vector<Pair> pairs = impl_->nearPairs();
  const bool far_apart = pairs.size() < result.scans;
  if (far_apart) pairs = impl_->followingPairs();
  impl_->compare(pairs);
  result.pairs = pairs.size();
  result.counts = sumOf(pairs);
  result.verdict = AgreementVerdict::Usual;
  AgreementCounts now = result.counts;
  if (!far_apart) {
    for (const std::size_t scan : impl_->takeOutliers(pairs)) result.outliers.push_back(impl_->scans[scan].name);
    if (!result.outliers.empty()) {
      result.verdict = AgreementVerdict::Doubtful;
      now = sumOf(pairs);  // of the others
    }
  }
  const std::uint64_t answers = now.agreeing + now.contradicting;
  if (const auto best = impl_->bestChange(pairs, now, far_apart)) {
    if (best->gain() >= (collapses(best->change) ? kCollapseGain : kDoubtfulGain)) {
      const bool against = now.share() < kUncontradicted || best->gain() >= kSureGain;
      const bool sure = against && (now.share() < kSureShare || best->change.counts.score() >= kSureScore);
      result.verdict = sure && best->gain() >= kDisagreeGain ? AgreementVerdict::Disagree : AgreementVerdict::Doubtful;
      result.cure = best->change;
    }
  }
  if (answers < kLeastAnswers) {
    if (result.verdict != AgreementVerdict::Usual) return result;
    result.verdict = AgreementVerdict::NotMeasured;
    result.why_not = "the scans see too little in common";
    return result;
  }
  if (!far_apart && now.share() < kDisagreeShare) {
    result.verdict = AgreementVerdict::Disagree;
  } else if (!far_apart && now.share() < kDoubtfulShare) {
    result.verdict = std::max(result.verdict, AgreementVerdict::Doubtful);
  }
  return result;
}

}  // namespace accessvdb::io
