// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "sim/pine_skeleton.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>

#include "accessvdb/error.h"
#include "sim/angles.h"
#include "sim/counter_random.h"

namespace accessvdb::sim {
namespace {

using Eigen::Vector3d;

// Every number and its source: docs/PAPER.md, "The pine". Lengths are metres, or shares of the height.
constexpr double kBreastHeight = 1.3;
constexpr double kDiameterPerHeight = 0.018;
constexpr double kTaperPower = 0.8;
constexpr double kTipRadius = 0.004;
constexpr double kSweepPerHeight = 0.01;
constexpr double kCrownBase = 0.10;                           // of the height
constexpr double kInternode = 0.55, kInternodeShrink = 0.45;  // at the ground; share lost towards the top
constexpr int kBranchesMin = 4, kBranchesMax = 7;             // per whorl
constexpr double kInsertionLow = 75 * kDegree, kInsertionTop = 40 * kDegree, kInsertionSpread = 8 * kDegree;
constexpr double kCrownRadius = 0.20;  // of the height: the longest branch
constexpr double kCrownPower = 0.7;
constexpr double kBranchUpturn = 25 * kDegree;
constexpr double kBranchBaseRadius = 0.002, kBranchRadiusPerLength = 0.007;
constexpr double kBranchTipRadius = 0.0035;
constexpr double kTwigSpacing = 0.28, kTwigsBegin = 0.25;  // along the branch; share of it that is bare
constexpr int kTwigsMin = 2, kTwigsMax = 4;                // per node
constexpr double kTwigAngleMin = 42 * kDegree, kTwigAngleMax = 62 * kDegree;
constexpr double kTwigLengthShare = 0.45, kTwigLengthBase = 0.15;
constexpr double kTwigRadiusPerLength = 0.006, kTwigTipRadius = 0.003;
constexpr double kShootSpacing = 0.15;
constexpr double kShootLengthMin = 0.12, kShootLengthMax = 0.28;
constexpr double kShootRadius = 0.004, kShootTipRadius = 0.003;
constexpr double kShootAngleMin = 30 * kDegree, kShootAngleMax = 50 * kDegree;
constexpr double kNeedledTwig = 0.35;  // outer part of a twig that still bears needles
constexpr double kNeedleSpacing = 0.005;
constexpr double kNeedleLengthMin = 0.075, kNeedleLengthMax = 0.15;
constexpr double kNeedleAngleMin = 30 * kDegree, kNeedleAngleMax = 60 * kDegree;
constexpr double kNeedleRadius = 0.0015, kNeedleTipRadius = 0.0002;
constexpr double kGoldenAngle = 137.50776405003785 * kDegree;

/// splitmix64 (public domain, S. Vigna).
struct Generator {
  std::uint64_t state;

  double uniform() {  ///< [0, 1), 53 bits
    const std::uint64_t bits = mixBits(state);
    state += kSplitMixStep;
    return double(bits >> 11) * 0x1p-53;
  }
  double between(double low, double high) { return low + (high - low) * uniform(); }
  int whole(int low, int high) { return std::min(high, low + int(uniform() * (high - low + 1))); }
};

/// A unit vector at an angle from `axis`, rotated around it by `azimuth_rad` (0 = upwards for a horizontal axis).
Vector3d tilted(const Vector3d& axis, double angle_rad, double azimuth_rad) {
  const Vector3d side =
      (std::abs(axis.z()) < 0.99 ? axis.cross(Vector3d::UnitZ()) : axis.cross(Vector3d::UnitX())).normalized();
  const Vector3d up = side.cross(axis);
  return std::cos(angle_rad) * axis + std::sin(angle_rad) * (std::cos(azimuth_rad) * up + std::sin(azimuth_rad) * side);
}

/// A direction raised towards the vertical by an angle, not beyond it.
Vector3d raised(const Vector3d& direction, double angle_rad) {
  const double level = std::hypot(direction.x(), direction.y());
  const double elevation = std::min(std::atan2(direction.z(), level) + angle_rad, 85 * kDegree);
  if (!(level > 0)) return direction;
  return {std::cos(elevation) * direction.x() / level, std::cos(elevation) * direction.y() / level,
          std::sin(elevation)};
}

class Tree {
 public:
  explicit Tree(const PineParams& params) : height_m_(params.height_m), random_{params.seed} {}

  PineSkeleton grow() {
    tree_.trunk_diameter_m = kDiameterPerHeight * height_m_;
    const double sweep_azimuth = random_.between(0, 2 * std::numbers::pi);
    sweep_m_ = kSweepPerHeight * height_m_ * random_.between(0.5, 1) *
               Vector3d(std::cos(sweep_azimuth), std::sin(sweep_azimuth), 0);
    double z_m = 0, next_m = kCrownBase * height_m_;
    double turn = 0;
    while (next_m < height_m_ - 0.4) {
      growTrunk(z_m, next_m);
      z_m = next_m;
      turn += random_.between(0, std::numbers::pi);
      growWhorl(z_m, turn);
      next_m += kInternode * (1 - kInternodeShrink * z_m / height_m_) * random_.between(0.75, 1.25);
    }
    growTrunk(z_m, height_m_);
    growNeedles({trunkAt(std::max(z_m, height_m_ - 0.25)), trunkAt(height_m_), kTipRadius, kTipRadius});
    return std::move(tree_);
  }

 private:
  Vector3d trunkAt(double z_m) const {
    return Vector3d(0, 0, z_m) + std::sin(std::numbers::pi * z_m / height_m_) * sweep_m_;
  }
  double trunkRadius(double z_m) const {
    const double share = std::pow((height_m_ - z_m) / (height_m_ - kBreastHeight), kTaperPower);
    return std::max(kTipRadius, 0.5 * kDiameterPerHeight * height_m_ * share);
  }

  void growTrunk(double begin_m, double end_m) {
    tree_.trunk.push_back({trunkAt(begin_m), trunkAt(end_m), trunkRadius(begin_m), trunkRadius(end_m)});
  }

  void growWhorl(double z_m, double turn) {
    ++tree_.whorls;
    const double in_crown = (z_m / height_m_ - kCrownBase) / (1 - kCrownBase);  // 0 at its base, 1 at the top
    const int count = random_.whole(kBranchesMin, kBranchesMax);
    // Full at a sixth of the crown; the lowest branches are shaded and shorter.
    const double reach = std::pow(1 - in_crown, kCrownPower) * (0.65 + 0.35 * std::min(1.0, 6 * in_crown));
    for (int n = 0; n < count; ++n) {
      const double azimuth = turn + 2 * std::numbers::pi * (n + random_.between(-0.2, 0.2)) / count;
      const double from_vertical = kInsertionLow + (kInsertionTop - kInsertionLow) * in_crown +
                                   random_.between(-kInsertionSpread, kInsertionSpread);
      const double length_m = std::max(0.2, kCrownRadius * height_m_ * reach * random_.between(0.75, 1.15));
      const Vector3d direction(std::sin(from_vertical) * std::cos(azimuth), std::sin(from_vertical) * std::sin(azimuth),
                               std::cos(from_vertical));
      growBranch(trunkAt(z_m + random_.between(-0.04, 0.04)), direction, length_m, trunkRadius(z_m));
    }
  }

  void growBranch(const Vector3d& root, const Vector3d& insertion, double length_m, double trunk_radius_m) {
    ++tree_.branch_count;
    const int pieces = std::max(2, int(std::lround(length_m / kTwigSpacing)));
    const double piece_m = length_m / pieces;
    const double thick_m = std::min(kBranchBaseRadius + kBranchRadiusPerLength * length_m, 0.6 * trunk_radius_m);
    const auto radius = [&](double along) {
      return std::max(kBranchTipRadius, thick_m + (kBranchTipRadius - thick_m) * along);
    };
    Vector3d at = root, direction = insertion;
    for (int n = 0; n < pieces; ++n) {
      const double begin = double(n) / pieces, end = double(n + 1) / pieces;
      direction = raised(insertion, kBranchUpturn * begin);
      // One number per statement, here and below: the order within an expression is the compiler's.
      const double turned = random_.between(0, 2 * std::numbers::pi), by = random_.between(0, 3 * kDegree);
      direction = tilted(direction, by, turned);
      const Vector3d next = at + piece_m * direction;
      tree_.branches.push_back({at, next, radius(begin), radius(end)});
      at = next;
      if (end < kTwigsBegin || n + 1 == pieces) continue;
      const int twigs = random_.whole(kTwigsMin, kTwigsMax);
      const double turn = random_.between(0, 2 * std::numbers::pi);
      for (int k = 0; k < twigs; ++k) {
        const double azimuth = turn + 2 * std::numbers::pi * (k + random_.between(-0.25, 0.25)) / twigs;
        const double twig_m = kTwigLengthBase + kTwigLengthShare * length_m * (1 - end) * random_.between(0.6, 1.1);
        growTwig(at, tilted(direction, random_.between(kTwigAngleMin, kTwigAngleMax), azimuth), twig_m,
                 0.8 * radius(end));
      }
    }
    growShoot(at, direction, random_.between(kShootLengthMin, kShootLengthMax));
  }

  void growTwig(const Vector3d& root, const Vector3d& insertion, double length_m, double most_radius_m) {
    const int pieces = std::max(1, int(std::lround(length_m / kShootSpacing)));
    const double piece_m = length_m / pieces;
    const double thick_m =
        std::max(kTwigTipRadius, std::min(kTwigTipRadius + kTwigRadiusPerLength * length_m, most_radius_m));
    const auto radius = [&](double along) { return thick_m + (kTwigTipRadius - thick_m) * along; };
    Vector3d at = root, direction = insertion;
    for (int n = 0; n < pieces; ++n) {
      const double begin = double(n) / pieces, end = double(n + 1) / pieces;
      direction = raised(insertion, 0.6 * kBranchUpturn * begin);
      const Vector3d next = at + piece_m * direction;
      const RoundCone piece{at, next, radius(begin), radius(end)};
      tree_.twigs.push_back(piece);
      if (length_m * (1 - begin) <= kNeedledTwig + piece_m) growNeedles(piece);
      at = next;
      if (n + 1 == pieces) break;
      const double angle = random_.between(kShootAngleMin, kShootAngleMax);
      const double shoot_m = random_.between(kShootLengthMin, kShootLengthMax);
      growShoot(at, tilted(direction, angle, random_.between(0, 2 * std::numbers::pi)), shoot_m);
    }
    growShoot(at, direction, random_.between(kShootLengthMin, kShootLengthMax));
  }

  void growShoot(const Vector3d& root, const Vector3d& direction, double length_m) {
    // Young shoots point upwards: the candles of a pine.
    const RoundCone shoot{root, root + length_m * raised(direction, 15 * kDegree), kShootRadius, kShootTipRadius};
    tree_.shoots.push_back(shoot);
    growNeedles(shoot);
  }

  /// Grows needles along an axis, in a spiral with the golden angle.
  void growNeedles(const RoundCone& stem) {
    const Vector3d along = stem.b_W - stem.a_W;
    const double length_m = along.norm();
    const Vector3d axis = along / length_m;
    for (double s = kNeedleSpacing * random_.uniform(); s < length_m; s += kNeedleSpacing) {
      needle_turn_ += kGoldenAngle;
      const double angle = random_.between(kNeedleAngleMin, kNeedleAngleMax);
      const Vector3d root = stem.a_W + s * axis;
      const Vector3d tip =
          root + random_.between(kNeedleLengthMin, kNeedleLengthMax) * tilted(axis, angle, needle_turn_);
      tree_.needles.push_back({root, tip, kNeedleRadius, kNeedleTipRadius});
    }
  }

  double height_m_;
  Generator random_;
  Vector3d sweep_m_ = {0, 0, 0};
  double needle_turn_ = 0;
  PineSkeleton tree_;
};

}  // namespace

PineSkeleton growPine(const PineParams& params) {
  if (!(params.height_m >= 2 && params.height_m <= 60))
    throw InvalidArgument("simulation.pine_height", "pine height", "must be between 2 and 60 m",
                          "Radiata pines grow 15 to 30 m high in the wild");
  return Tree(params).grow();
}

}  // namespace accessvdb::sim
