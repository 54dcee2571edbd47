// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/query/pose_fits.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>
#include <span>
#include <utility>

#include "accessvdb/error.h"
#include "field/query/query_checks.h"
#include "tool/tool_kernel.h"
#include "tool/tool_rolls.h"
#include "tool/tool_solid.h"
#include "tsdf/leaf_facts.h"

namespace accessvdb {
namespace internal {
namespace {

/// Of two rotations that are the same but for rounding, entries differ by at most this.
constexpr double kSameRotation = 1e-5;

}  // namespace

kernels::ToolBitmapView FittedTool::bitmap(kernels::Backend& backend, double voxel_size_m) {
  if (!bitmap_) {
    auto made = std::make_unique<ToolBitmap>(tool_, voxel_size_m);
    d_words_.grow(backend, made->words.size(), 0);
    d_words_.upload(made->words.data(), made->words.size());
    bitmap_ = std::move(made);
  }
  return bitmap_->view(d_words_.data());
}

Eigen::Matrix3d FittedTool::ownOrientation(const Eigen::Matrix3d& R_WT) {
  if (own_.empty()) {
    const ToolRolls rolls = scoring_.setup.tool().rolls;
    for (const ToolOrientation& orientation : ExpandedOrientations::of(scoring_.params.approach).all) {
      for (int roll = 0; roll < rolls.count; ++roll) own_.push_back(rolledBy(orientation, rolls, roll).R_WT);
    }
  }
  const auto own = std::ranges::find_if(
      own_, [&](const Eigen::Matrix3d& R) { return (R - R_WT).cwiseAbs().maxCoeff() <= kSameRotation; });
  return own == own_.end() ? R_WT : *own;
}

}  // namespace internal

namespace {

using internal::FittedTool;
using kernels::ToolFit;
using kernels::ToolPlace;

constexpr std::size_t kPosesAtOnce = std::size_t{1} << 16;
constexpr double kMostTries = 1 << 20;

/// Facts of leaves, as the mirror has them.
class CollidingLeaves {
 public:
  explicit CollidingLeaves(const internal::PackedMap& map) : map_(map), accessor_(map.tree()) {}

  [[nodiscard]] const LeafChange& at(const openvdb::Coord& origin) {
    const auto [found, is_new] = leaves_.try_emplace({origin.x(), origin.y(), origin.z()});
    if (is_new) found->second = internal::factsAt(map_, accessor_, origin).value_or(LeafChange{});
    return found->second;
  }

 private:
  const internal::PackedMap& map_;
  internal::ConstPackedAccessor accessor_;
  std::map<std::array<std::int32_t, 3>, LeafChange> leaves_;
};

/// The tool around the voxel of its tip, as the field's tables have it.
internal::SolidVoxels voxelsInContact(FittedTool& tool, const Eigen::Matrix3d& R_WT) {
  const FieldParams& params = tool.scoring().params;
  const double v = params.tsdf.voxel_size_m;
  return internal::ToolSolid(tool.geometry())
      .voxels(internal::turnedVertices(tool.geometry(), R_WT, 1 / v), v, params.scoring.self_exclusion_voxels);
}

FitAnswer fitInContact(FittedTool& tool, CollidingLeaves& leaves, const internal::SolidVoxels& voxels,
                       const ToolPlace& place) {
  FitAnswer answer;
  answer.valid = true;
  answer.collision_limit = tool.scoring().collisionLimit();
  for (const internal::VoxelRun& run : voxels.runs) {
    const std::int32_t x = place.anchor[0] + run.i, y = place.anchor[1] + run.j;
    for (std::int32_t z = place.anchor[2] + run.lo; z <= place.anchor[2] + run.hi; ++z) {
      const LeafChange& facts = leaves.at({x & ~7, y & ~7, z & ~7});
      const std::uint64_t bit = std::uint64_t{1} << (8 * (y & 7) + (z & 7));
      const auto word = static_cast<std::size_t>(x & 7);
      const bool collides = (facts.collides_on[word] & bit) != 0;
      answer.collisions += collides ? 1 : 0;
      answer.unknown_voxels += !collides && (facts.arm_free_on[word] & bit) == 0 ? 1 : 0;
    }
  }
  return answer;
}

/// Distances before contact, one for each voxel that the tip is in on its way.
std::vector<double> voxelsOfTip_m(const Eigen::Vector3d& tip_L, const Eigen::Vector3d& axis, double way_m, double v) {
  std::vector<double> borders = {0, way_m};
  for (int k = 0; k < 3; ++k) {
    const double begin = tip_L[k] / v + 0.5, end = begin + way_m * axis[k] / v;
    for (double at = std::ceil(std::min(begin, end)); at <= std::max(begin, end); at += 1)
      if (axis[k] != 0) borders.push_back(std::clamp((at - begin) * v / axis[k], 0.0, way_m));
  }
  std::sort(borders.begin(), borders.end());
  std::vector<double> inside_m = {0};
  for (std::size_t n = 0; n + 1 < borders.size(); ++n)
    if (borders[n + 1] > borders[n]) inside_m.push_back((borders[n] + borders[n + 1]) / 2);
  inside_m.push_back(way_m);
  return inside_m;
}

/// How many tries each part of a way takes, its end included. @return nothing if they are too many
std::optional<std::vector<std::size_t>> triesOf(std::span<const Eigen::Isometry3d> T_WT, double reach_m,
                                                double voxel_size_m) {
  std::vector<std::size_t> tries;
  double all = 1;
  for (std::size_t n = 0; n + 1 < T_WT.size(); ++n) {
    const Eigen::AngleAxisd turn(T_WT[n].linear().transpose() * T_WT[n + 1].linear());
    const double moved_m =
        (T_WT[n + 1].translation() - T_WT[n].translation()).norm() + std::abs(turn.angle()) * reach_m;
    const double of_part = std::max(1.0, std::ceil(2 * moved_m / voxel_size_m));
    if (!((all += of_part) <= kMostTries)) return std::nullopt;
    tries.push_back(static_cast<std::size_t>(of_part));
  }
  return tries;
}

}  // namespace

struct ACCESSVDB_PRIVATE PoseQuery::Impl {
  internal::FitInputs field;
  internal::PoseFits* fits = nullptr;
  std::uint64_t revision = 0;

  [[nodiscard]] bool current() const { return field.field_revision->load(std::memory_order_acquire) == revision; }
  void requireCurrent() const { internal::requireCurrent(current(), "poseQuery"); }
  [[nodiscard]] FittedTool& tool(std::size_t k) const {
    static_cast<void>(field.tools->at(k));  // throws for one that is not there
    return *fits->tools_[k];
  }
  [[nodiscard]] ToolPlace placeOf(const Eigen::Isometry3d& T_WT, bool& valid) const {
    const Eigen::Vector3d tip_L = T_WT.translation() - field.origin_W;
    const Eigen::Matrix3d R_WT = T_WT.linear();
    ToolPlace place;
    valid = kernels::makeToolPlace(R_WT.data(), tip_L.data(), field.mirror.inverse_voxel_size, place);
    return place;
  }
  /// @param T_WT  all valid
  std::vector<ToolFit> fitAll(std::span<const ToolPlace> places, std::size_t k,
                              const kernels::EnoughOfFit& enough = {}) const {
    std::vector<ToolFit> answers(places.size());
    std::unique_lock lock(fits->mutex_);
    const kernels::ToolBitmapView bitmap = tool(k).bitmap(*field.backend, field.map->params().voxel_size_m);
    if (field.backend->hasHostMemory()) lock.unlock();  // a GPU has one stream
    field.backend->waitForMirror();
    field.arena->execute([&] {
      field.backend->fitTool({field.mirror, bitmap, places.data(), answers.data(), places.size(), enough});
    });
    return answers;
  }
};

PoseQuery::PoseQuery(std::shared_ptr<const Impl> impl) : impl_(std::move(impl)) {}
std::uint64_t PoseQuery::revision() const { return impl_->revision; }
bool PoseQuery::current() const { return impl_->current(); }

void PoseQuery::fits(std::span<const Eigen::Isometry3d> T_WT, std::span<FitAnswer> answers,
                     const FitOptions& options) const {
  internal::requireSizes(T_WT.size(), answers.size());
  impl_->requireCurrent();
  FittedTool& tool = impl_->tool(options.tool);
  if (options.contact) {
    std::vector<Eigen::Matrix3d> R_WT(T_WT.size());
    {
      const std::scoped_lock lock(impl_->fits->mutex_);
      for (std::size_t n = 0; n < T_WT.size(); ++n) R_WT[n] = tool.ownOrientation(T_WT[n].linear());
    }
    // Poses one after the other that are turned alike, as on a way in, share their voxels.
    constexpr std::size_t kMostTogether = 64;
    std::vector<std::size_t> begins;
    for (std::size_t n = 0; n < T_WT.size(); ++n)
      if (n == 0 || R_WT[n] != R_WT[n - 1] || n - begins.back() == kMostTogether) begins.push_back(n);
    begins.push_back(T_WT.size());
    impl_->field.arena->execute([&] {
      tbb::parallel_for(std::size_t{0}, begins.size() - 1, [&](std::size_t group) {
        std::optional<internal::SolidVoxels> voxels;
        CollidingLeaves leaves(*impl_->field.map);
        for (std::size_t n = begins[group]; n < begins[group + 1]; ++n) {
          bool valid = false;
          const ToolPlace place = impl_->placeOf(T_WT[n], valid);
          if (valid && !voxels) voxels = voxelsInContact(tool, R_WT[n]);
          answers[n] = valid ? fitInContact(tool, leaves, *voxels, place) : FitAnswer{};
        }
      });
    });
    return;
  }
  for (std::size_t first = 0; first < T_WT.size(); first += kPosesAtOnce) {
    const std::size_t count = std::min(T_WT.size() - first, kPosesAtOnce);
    const std::span<FitAnswer> part = answers.subspan(first, count);
    std::vector<ToolPlace> places(count);  // of a bad pose, any
    const auto forEach = [&](const auto& visit) {
      impl_->field.arena->execute([&] { tbb::parallel_for(std::size_t{0}, count, visit); });
    };
    forEach([&](std::size_t n) {
      part[n] = {};
      places[n] = impl_->placeOf(T_WT[first + n], part[n].valid);
    });
    const std::vector<ToolFit> found = impl_->fitAll(places, options.tool);
    forEach([&](std::size_t n) {
      if (!part[n].valid) return;
      part[n].valid = found[n].valid;
      part[n].collisions = found[n].collisions;
      part[n].unknown_voxels = found[n].unknown;
    });
  }
}

double PoseQuery::contactWay_m(std::size_t tool) const {
  const FieldParams& params = impl_->tool(tool).scoring().params;
  return (params.scoring.self_exclusion_voxels + 2) * params.tsdf.voxel_size_m;
}

std::vector<FitAnswer> PoseQuery::fitsIntoContact(std::span<const Eigen::Isometry3d> contact_T_WT,
                                                  std::size_t tool) const {
  const double way_m = contactWay_m(tool), v = impl_->field.map->params().voxel_size_m;
  std::vector<Eigen::Isometry3d> poses;
  std::vector<std::size_t> ends;
  for (const Eigen::Isometry3d& T_WT : contact_T_WT) {
    bool valid = false;
    static_cast<void>(impl_->placeOf(T_WT, valid));
    const Eigen::Vector3d axis = T_WT.linear().col(0);
    const Eigen::Vector3d tip_L = T_WT.translation() - impl_->field.origin_W;
    for (const double back_m : valid ? voxelsOfTip_m(tip_L, axis, way_m, v) : std::vector<double>{0}) {
      poses.push_back(T_WT);
      poses.back().translation() += back_m * axis;
    }
    ends.push_back(poses.size());
  }
  const std::vector<FitAnswer> each = fits(poses, {.tool = tool, .contact = true});
  std::vector<FitAnswer> answers;
  for (std::size_t n = 0; n < ends.size(); ++n) {
    const std::size_t begin = n == 0 ? 0 : ends[n - 1];
    FitAnswer most = each[begin];
    for (std::size_t k = begin; k < ends[n]; ++k) {
      most.valid = most.valid && each[k].valid;
      most.collisions = std::max(most.collisions, each[k].collisions);
      most.unknown_voxels = std::max(most.unknown_voxels, each[k].unknown_voxels);
    }
    answers.push_back(most);
  }
  return answers;
}

std::vector<FitAnswer> PoseQuery::fits(std::span<const Eigen::Isometry3d> T_WT, const FitOptions& options) const {
  std::vector<FitAnswer> answers(T_WT.size());
  fits(T_WT, answers, options);
  return answers;
}

kernels::ToolBitmapView PoseQuery::toolView(std::size_t tool) const {
  impl_->requireCurrent();
  FittedTool& fitted = impl_->tool(tool);
  const std::scoped_lock lock(impl_->fits->mutex_);
  return fitted.bitmap(*impl_->field.backend, impl_->field.map->params().voxel_size_m);
}

PathFitAnswer PoseQuery::fitsAlong(std::span<const Eigen::Isometry3d> T_WT, const PathFitOptions& options) const {
  impl_->requireCurrent();
  const double voxel_size_m = impl_->field.map->params().voxel_size_m;
  PathFitAnswer answer;
  const FittedTool& fitted = impl_->tool(options.tool);
  for (const Eigen::Isometry3d& pose : T_WT) {
    bool valid = false;
    static_cast<void>(impl_->placeOf(pose, valid));
    if (!valid) return answer;
  }
  if (T_WT.empty()) return answer;
  const auto tries = triesOf(T_WT, fitted.geometry().reach_m(), voxel_size_m);
  if (!tries) return answer;
  answer.collision = answer.unknown = false;
  std::vector<ToolPlace> places;
  std::vector<double> at;
  // Few at first: most ways that collide do so soon.
  std::size_t at_once = 64;
  bool ended = false;
  const kernels::EnoughOfFit enough = {.collisions = 1, .unknown = options.unknown_blocks ? 1U : 0U};
  const auto tryThem = [&] {
    std::vector<ToolFit> found = impl_->fitAll(places, options.tool, enough);
    for (std::size_t n = 0; n < found.size() && !ended; ++n) {
      if (!found[n].valid) return false;
      if (options.unknown_blocks && (found[n].collisions | found[n].unknown) != 0) {
        // Which of the two was found first is the backend's affair.
        found[n] = impl_->fitAll({&places[n], 1}, options.tool)[0];
      }
      answer.collision = found[n].collisions > 0;
      if (answer.collision) answer.first_hit = at[n];
      ended = answer.collision || (options.unknown_blocks && found[n].unknown > 0);
      answer.unknown = answer.unknown || (found[n].unknown > 0 && (options.unknown_blocks || !answer.collision));
      if (!ended) answer.fits_until = at[n];
    }
    places.clear();
    at.clear();
    at_once = std::min(4 * at_once, kPosesAtOnce);
    return true;
  };
  const auto add = [&](const Eigen::Isometry3d& pose, double where) {
    bool valid = false;
    places.push_back(impl_->placeOf(pose, valid));
    at.push_back(where);
    return valid && (places.size() < at_once || tryThem());
  };
  bool fine = add(T_WT.front(), 0);
  for (std::size_t n = 0; fine && !ended && n + 1 < T_WT.size(); ++n) {
    const Eigen::Quaterniond from(T_WT[n].linear()), to(T_WT[n + 1].linear());
    for (std::size_t k = 1; fine && !ended && k <= (*tries)[n]; ++k) {
      if (k == (*tries)[n]) {
        fine = add(T_WT[n + 1], static_cast<double>(n + 1));
        break;
      }
      const double t = static_cast<double>(k) / static_cast<double>((*tries)[n]);
      Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
      pose.linear() = from.slerp(t, to).normalized().toRotationMatrix();
      pose.translation() = (1 - t) * T_WT[n].translation() + t * T_WT[n + 1].translation();
      fine = add(pose, static_cast<double>(n) + t);
    }
  }
  if (fine && !ended && !places.empty()) fine = tryThem();
  if (!fine) return {};
  answer.valid = true;
  return answer;
}

PoseQuery internal::PoseFits::query(const FitInputs& field) {
  if (tools_.empty()) {
    std::vector<std::unique_ptr<FittedTool>> tools;
    for (std::size_t k = 0; k < field.tools->size(); ++k) {
      tools.push_back(std::make_unique<FittedTool>(field.tools->specs()[k].tool, field.tools->at(k)));
    }
    tools_ = std::move(tools);
  }
  auto impl = std::make_shared<PoseQuery::Impl>();
  impl->field = field;
  impl->fits = this;
  impl->revision = field.field_revision->load(std::memory_order_acquire);
  return PoseQuery(impl);
}

}  // namespace accessvdb
