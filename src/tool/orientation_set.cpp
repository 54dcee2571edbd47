// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include <Eigen/LU>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <numbers>
#include <set>

#include "accessvdb/error.h"
#include "accessvdb/orientations.h"
#include "tool/yaw_direction.h"

namespace accessvdb {
namespace {

using internal::CosSin;

constexpr double kRightAngle_deg = 90, kRadiansPerDegree = std::numbers::pi / 180;
/// Quotients of degrees are meant as whole numbers if they are this near to one.
constexpr double kWholeSlack = 1e-9;
constexpr int kMostYaws = 256;

std::string text(double value) {
  std::array<char, 32> buffer;
  return {buffer.data(), std::to_chars(buffer.data(), buffer.data() + buffer.size(), value).ptr};
}

[[noreturn]] void refuseRange(const std::string& problem, const std::string& advice) {
  throw InvalidArgument("orientations.range", "orientations", problem, advice);
}

/// Rz(yaw) Ry(-pitch) Rx(roll). Where an angle is 0, nothing is rounded: yaw alone gives (cos, sin) as it is.
Eigen::Matrix3d rotation(const CosSin& yaw, const CosSin& pitch, const CosSin& roll) {
  const Eigen::Vector3d level(-yaw.sin, yaw.cos, 0);
  const Eigen::Vector3d up(-yaw.cos * pitch.sin, -yaw.sin * pitch.sin, pitch.cos);
  Eigen::Matrix3d R_WT;
  R_WT.col(0) = Eigen::Vector3d(yaw.cos * pitch.cos, yaw.sin * pitch.cos, pitch.sin);
  R_WT.col(1) = roll.cos * level + roll.sin * up;
  R_WT.col(2) = -roll.sin * level + roll.cos * up;
  return R_WT;
}

/// Orientations without roll at one pitch.
struct Ring {
  CosSin pitch;
  double pitch_rad;
  int count;  ///< 1 straight up and down, where yaw means nothing
};

void addRing(const Ring& ring, std::vector<ToolOrientation>& out) {
  for (int d = 0; d < ring.count; ++d) {
    const CosSin yaw = internal::yawDirection(d, ring.count);
    // As files have recorded yaw from the start, up to its last bit.
    const double yaw_rad = 2 * std::numbers::pi * d / ring.count;
    out.push_back({rotation(yaw, ring.pitch, {1, 0}), yaw_rad, ring.pitch_rad, 0});
  }
}

int wholeBelow(double value) { return static_cast<int>(std::floor(value + kWholeSlack)); }
int nearestWhole(double value) { return wholeBelow(value + 0.5); }

std::vector<Ring> pitchRings(const OrientationSet& set, int num_directions) {
  const double span_deg = set.pitch_max_deg - set.pitch_min_deg;
  const double last = span_deg / set.step_deg;
  // More rings than this do not fit anyway, and must not overflow.
  const int rings = last < 4 * OrientationSet::kMost ? wholeBelow(last) + 1 : 4 * OrientationSet::kMost;
  std::vector<Ring> made;
  for (int n = 0; n < rings; ++n) {
    double pitch_deg = set.pitch_min_deg + n * set.step_deg;
    if (pitch_deg > set.pitch_max_deg) pitch_deg = set.pitch_max_deg;  // by rounding
    const bool upright = std::abs(pitch_deg) == kRightAngle_deg;
    made.push_back(
        {internal::degreesDirection(pitch_deg), pitch_deg * kRadiansPerDegree, upright ? 1 : num_directions});
  }
  return made;
}

/// Rings at whole fractions of half a turn, with the equator and both poles; from below upwards.
std::vector<Ring> sphereRings(double step_deg) {
  const int quarter = std::max(1, nearestWhole(kRightAngle_deg / step_deg));  // rings from the equator to a pole
  std::vector<Ring> made;
  for (int n = -quarter; n <= quarter; ++n) {
    const CosSin pitch = internal::yawDirection((n + 4 * quarter) % (4 * quarter), 4 * quarter);
    const bool upright = n == -quarter || n == quarter;
    const int count = upright ? 1 : 4 * std::max(1, nearestWhole(kRightAngle_deg * pitch.cos / step_deg));
    made.push_back({pitch, 0.5 * std::numbers::pi * n / quarter, count});
  }
  return made;
}

int sizeOf(const std::vector<Ring>& rings) {
  int size = 0;
  for (const Ring& ring : rings) size += ring.count;
  return size;
}

/// The axis as scoring uses it.
std::array<float, 3> axisOf(const ToolOrientation& orientation) {
  std::array<float, 3> axis;
  for (int n = 0; n < 3; ++n) axis[static_cast<std::size_t>(n)] = static_cast<float>(orientation.R_WT(n, 0)) + 0.0f;
  return axis;
}

std::vector<ToolOrientation> sphere(double step_deg, bool with_yaw, int num_directions) {
  std::vector<ToolOrientation> all;
  std::set<std::array<float, 3>> known;
  if (with_yaw) {
    addRing({{1, 0}, 0, num_directions}, all);
    for (const ToolOrientation& orientation : all) known.insert(axisOf(orientation));
  }
  std::vector<ToolOrientation> rings;
  for (const Ring& ring : sphereRings(step_deg)) addRing(ring, rings);
  for (const ToolOrientation& orientation : rings) {
    if (!known.contains(axisOf(orientation))) all.push_back(orientation);
  }
  return all;
}

int sphereSize(double step_deg, bool with_yaw, int num_directions) {
  if (!with_yaw) return sizeOf(sphereRings(step_deg));
  return static_cast<int>(sphere(step_deg, true, num_directions).size());
}

/// The least STEP, in whole quarters of a degree, with which a sphere fits.
std::string sphereAdvice(bool with_yaw, int num_directions) {
  constexpr double kStep_deg = 0.25;
  for (int n = 1; n * kStep_deg <= kRightAngle_deg; ++n) {
    const double step_deg = n * kStep_deg;
    if (sphereSize(step_deg, with_yaw, num_directions) <= OrientationSet::kMost) {
      return "Use sphere:" + text(step_deg) + (with_yaw ? "+yaw" : "") + " or a larger step";
    }
  }
  return "Use fewer yaw directions (num_directions)";
}

/// @param rings  of the set
std::string pitchAdvice(const OrientationSet& set, int rings, int num_directions) {
  const int directions = OrientationSet::kMost / rings / 4 * 4;
  const int fitting = OrientationSet::kMost / num_directions;  // rings that fit
  std::string advice;
  if (directions >= 4)
    advice = std::to_string(directions) + " yaw directions (num_directions " + std::to_string(directions) + ")";
  static_assert(OrientationSet::kMost > 2 * kMostYaws, "some rings fit, whatever the number of yaws");
  const double step_deg = std::ceil((set.pitch_max_deg - set.pitch_min_deg) / (fitting - 1) * 100) / 100;
  advice += (advice.empty() ? "" : " or ") + std::string("a STEP of ") + text(step_deg) + " degrees";
  return "Use " + advice;
}

void requireRange(const OrientationSet& set, int num_directions) {
  const auto within = [](double value, double low, double high) { return value >= low && value <= high; };
  if (set.kind == OrientationKind::Pitch) {
    if (!within(set.pitch_min_deg, -kRightAngle_deg, kRightAngle_deg) ||
        !within(set.pitch_max_deg, set.pitch_min_deg, kRightAngle_deg)) {
      refuseRange("pitches from " + text(set.pitch_min_deg) + " to " + text(set.pitch_max_deg) + " degrees",
                  "Use a range within -90 .. 90, the lower one first");
    }
    if (!within(set.step_deg, 0.01, 2 * kRightAngle_deg)) {
      refuseRange("a step of " + text(set.step_deg) + " degrees", "Use a STEP of 0.01 .. 180 degrees");
    }
  }
  if (set.kind == OrientationKind::Sphere && !within(set.step_deg, 1, kRightAngle_deg)) {
    refuseRange("a step of " + text(set.step_deg) + " degrees", "Use a STEP of 1 .. 90 degrees");
  }
  if (set.kind == OrientationKind::List && set.list.empty()) refuseRange("an empty list", "List at least one");
  if (!within(num_directions, 4, kMostYaws)) {
    refuseRange(std::to_string(num_directions) + " yaw directions", "Use 4 .. 256");
  }
}

/// Hash of a list's rotations, which tells two lists of the same length apart. FNV-1a, 64 bits.
std::string hashOf(const std::vector<ToolOrientation>& list) {
  std::uint64_t hash = 0xcbf29ce484222325ull;
  for (const ToolOrientation& orientation : list) {
    for (Eigen::Index n = 0; n < 9; ++n) {
      const double value = orientation.R_WT.data()[n] + 0.0;  // -0 and 0 are the same rotation
      std::uint64_t bits = 0;
      std::memcpy(&bits, &value, sizeof bits);
      for (int byte = 0; byte < 8; ++byte) hash = (hash ^ (bits >> (8 * byte) & 0xffu)) * 0x100000001b3ull;
    }
  }
  std::array<char, 20> out;
  std::snprintf(out.data(), out.size(), "%016llx", static_cast<unsigned long long>(hash));
  return out.data();
}

}  // namespace

OrientationSet OrientationSet::pitch(double min_deg, double max_deg, double step_deg) {
  OrientationSet set;
  set.kind = OrientationKind::Pitch;
  set.pitch_min_deg = min_deg;
  set.pitch_max_deg = max_deg;
  set.step_deg = step_deg;
  return set;
}

OrientationSet OrientationSet::sphere(double step_deg, bool with_yaw) {
  OrientationSet set;
  set.kind = OrientationKind::Sphere;
  set.step_deg = step_deg;
  set.with_yaw = with_yaw;
  return set;
}

OrientationSet OrientationSet::of(std::vector<ToolOrientation> list) {
  OrientationSet set;
  set.kind = OrientationKind::List;
  set.list = std::move(list);
  return set;
}

std::string OrientationSet::text() const {
  switch (kind) {
    case OrientationKind::Yaw:
      return "yaw";
    case OrientationKind::Pitch:
      return "pitch:" + accessvdb::text(pitch_min_deg) + ":" + accessvdb::text(pitch_max_deg) + ":" +
             accessvdb::text(step_deg);
    case OrientationKind::Sphere:
      return "sphere:" + accessvdb::text(step_deg) + (with_yaw ? "+yaw" : "");
    case OrientationKind::List:
      break;
  }
  return "list:" + std::to_string(list.size()) + ":" + hashOf(list);
}

int OrientationSet::count(int num_directions) const {
  if (kind == OrientationKind::Yaw) return num_directions;
  return static_cast<int>(orientations(num_directions).size());
}

std::vector<ToolOrientation> OrientationSet::orientations(int num_directions) const {
  requireRange(*this, num_directions);
  const auto refuse = [&](const std::string& size, const std::string& advice) {
    throw ResourceLimit("orientations.count", this->text(),
                        "has " + size + " orientations; at most " + std::to_string(kMost) + " can be handled", advice);
  };
  std::vector<ToolOrientation> all;
  switch (kind) {
    case OrientationKind::Yaw:
      addRing({{1, 0}, 0, num_directions}, all);
      break;
    case OrientationKind::Pitch: {
      const std::vector<Ring> rings = pitchRings(*this, num_directions);
      const int count = static_cast<int>(rings.size()), size = sizeOf(rings);
      if (size > kMost) {
        refuse(count < 4 * kMost ? std::to_string(size) : "more than " + std::to_string(4 * kMost),
               pitchAdvice(*this, count, num_directions));
      }
      for (const Ring& ring : rings) addRing(ring, all);
      break;
    }
    case OrientationKind::Sphere:
      if (const int size = sphereSize(step_deg, with_yaw, num_directions); size > kMost) {
        refuse(std::to_string(size), sphereAdvice(with_yaw, num_directions));
      }
      all = accessvdb::sphere(step_deg, with_yaw, num_directions);
      break;
    case OrientationKind::List:
      if (list.size() > static_cast<std::size_t>(kMost)) refuse(std::to_string(list.size()), "Shorten the list");
      for (const ToolOrientation& orientation : list) {
        constexpr double kRigid = 1e-6;
        const Eigen::Matrix3d& R = orientation.R_WT;
        const bool rigid = R.allFinite() &&
                           (R * R.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() < kRigid &&
                           R.determinant() > 0 && std::isfinite(orientation.yaw_rad) &&
                           std::isfinite(orientation.pitch_rad) && std::isfinite(orientation.roll_rad);
        if (!rigid) refuseRange("a matrix that is no rotation", "Use orientationOf() to make orientations");
      }
      all = list;
      break;
  }
  return all;
}

ToolOrientation orientationOf(double yaw_deg, double pitch_deg, double roll_deg) {
  if (!std::isfinite(yaw_deg) || !std::isfinite(roll_deg) || !(std::abs(pitch_deg) <= kRightAngle_deg)) {
    refuseRange("yaw " + text(yaw_deg) + ", pitch " + text(pitch_deg) + ", roll " + text(roll_deg),
                "Use finite degrees, and a pitch within -90 .. 90");
  }
  return {rotation(internal::degreesDirection(yaw_deg), internal::degreesDirection(pitch_deg),
                   internal::degreesDirection(roll_deg)),
          yaw_deg * std::numbers::pi / 180, pitch_deg * kRadiansPerDegree, roll_deg * kRadiansPerDegree};
}

ToolOrientation orientationOf(double w, double x, double y, double z) {
  constexpr double kNormSlack = 1e-3;
  const double norm = std::sqrt(w * w + x * x + y * y + z * z);
  if (!(std::abs(norm - 1) <= kNormSlack)) {
    refuseRange("a quaternion of norm " + text(norm), "Use unit quaternions, w first");
  }
  w /= norm, x /= norm, y /= norm, z /= norm;
  ToolOrientation made;
  made.R_WT << 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),  //
      2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),           //
      2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y);
  const Eigen::Matrix3d& R = made.R_WT;
  const double level = std::hypot(R(0, 0), R(1, 0));
  made.pitch_rad = std::atan2(R(2, 0), level);
  // Straight up or down, yaw is 0 and roll alone turns the tool.
  constexpr double kUpright = 1e-9;
  made.yaw_rad = level > kUpright ? std::atan2(R(1, 0), R(0, 0)) : 0;
  const CosSin yaw = {std::cos(made.yaw_rad), std::sin(made.yaw_rad)},
               pitch = {std::cos(made.pitch_rad), std::sin(made.pitch_rad)};
  const Eigen::Matrix3d unrolled = rotation(yaw, pitch, {1, 0});
  made.roll_rad = std::atan2(R.col(1).dot(unrolled.col(2)), R.col(1).dot(unrolled.col(1)));
  return made;
}

}  // namespace accessvdb
