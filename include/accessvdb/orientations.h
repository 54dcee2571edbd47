// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which orientations a tool can take: turned about the vertical only, tilted, over the whole sphere, or from a list
/// (docs/orientations.md).
///
/// An orientation takes tool coordinates to the world, z up: R = Rz(yaw) Ry(-pitch) Rx(roll). Its axis R x points
/// outwards along the tool's body, so at pitch +90 degrees the tool comes from above. With roll 0 the tool's +z is as
/// far up as possible; straight up or down, yaw is 0 and roll alone turns the tool.
///
/// Angles of sets are in degrees, because the whole fractions of a turn that have to be exact (0, 90, 180) have no
/// exact value in radians.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "accessvdb/export.h"

namespace accessvdb {

struct ToolOrientation {
  Eigen::Matrix3d R_WT = Eigen::Matrix3d::Identity();  ///< world from tool; the axis is its first column
  double yaw_rad = 0, pitch_rad = 0, roll_rad = 0;
};

enum class OrientationKind : std::uint8_t {
  Yaw,     ///< ApproachParams::num_directions level directions, evenly spread
  Pitch,   ///< rings of that many directions at several pitches
  Sphere,  ///< evenly over the sphere
  List     ///< one by one
};

/// A deterministic set of orientations: the same text gives the same bits. Order matters where orientations are equally
/// good: the first one is taken.
struct ACCESSVDB_API OrientationSet {
  /// Most orientations of a set. With more than kMostRemembered, updates take longer: of a point's directions nothing
  /// is remembered but the best one.
  static constexpr int kMost = 4096, kMostRemembered = 256;

  OrientationKind kind = OrientationKind::Yaw;
  double pitch_min_deg = 0, pitch_max_deg = 0;  ///< Pitch: of the rings, -90 .. 90
  /// Pitch: between the rings, > 0. Sphere: about the angle between neighbours, 1 .. 90.
  double step_deg = 0;
  bool with_yaw = false;              ///< Sphere: also the directions of Yaw, before the others
  std::vector<ToolOrientation> list;  ///< List: at least one; no two alike

  static OrientationSet yaw() { return {}; }
  static OrientationSet pitch(double min_deg, double max_deg, double step_deg);
  static OrientationSet sphere(double step_deg, bool with_yaw = false);
  static OrientationSet of(std::vector<ToolOrientation> list);
  /// "yaw", "pitch:MIN:MAX:STEP", "sphere:STEP", "sphere:STEP+yaw" or "list:FILE" (see read()).
  /// @throws InvalidArgument "orientations.text" or "orientations.range", InputError, ResourceLimit
  static OrientationSet parse(const std::string& text);
  /// A list: text, one orientation a line. The first line says what the numbers are: "yaw pitch roll" in degrees, or
  /// "qw qx qy qz", a unit quaternion, world from tool. Lines that are empty or begin with # are skipped, and so are
  /// orientations that an earlier line has already given. @param twins  out if given: how many those were
  /// @throws InputError "input.missing", "orientations.malformed"; ResourceLimit "orientations.count"
  static OrientationSet read(const std::filesystem::path& file, int* twins = nullptr);

  [[nodiscard]] bool isYaw() const { return kind == OrientationKind::Yaw; }
  /// As parse() reads it; of a list "list:N:HASH", its length and content.
  [[nodiscard]] std::string text() const;
  /// How many there are. @param num_directions  ApproachParams::num_directions
  /// @throws as orientations()
  [[nodiscard]] int count(int num_directions) const;
  /// All of them, by index. @throws InvalidArgument "orientations.range", ResourceLimit "orientations.count"
  [[nodiscard]] std::vector<ToolOrientation> orientations(int num_directions) const;
};

/// The orientation of three angles, degrees. @throws InvalidArgument "orientations.range" for one that is not finite,
///         or a pitch beyond 90 degrees
[[nodiscard]] ACCESSVDB_API ToolOrientation orientationOf(double yaw_deg, double pitch_deg, double roll_deg);
/// The orientation of a quaternion, world from tool; normalised. @throws InvalidArgument "orientations.range" if its
///         norm differs from 1 by more than a thousandth
[[nodiscard]] ACCESSVDB_API ToolOrientation orientationOf(double w, double x, double y, double z);

}  // namespace accessvdb
