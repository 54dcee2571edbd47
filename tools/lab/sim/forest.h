// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A planted forest of pines, for benchmarks: a flight along one of its lanes, of any length, never the same place
/// twice, and an orbit around one group of pines. What it is made of: docs/benchmarks/README.md.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "sim/placed_mesh.h"
#include "sim/trajectory.h"
#include "sim/triangle_mesh.h"

namespace accessvdb::sim {

struct ForestParams {
  double path_length_m = 60;   ///< length of the flight: along +x from the origin, in the middle of a lane
  double view_m = 30;          ///< how far the forest extends around the path; the sensor's range
  double solid_foliage_m = 0;  ///< as in makePineMesh()
  std::uint64_t seed = 1;
  bool clearing = false;  ///< around the origin, with one group of pines in its middle: for forestOrbit()
};

/// Pines in rows along x, ground, undergrowth. There is no exact distance: no ground truth is needed.
struct Forest {
  std::vector<TriangleMesh> meshes;  ///< each in its own frame
  std::vector<PlacedMesh> placed;
  std::size_t trees = 0;
  std::string description;  ///< one line
};

/// The same parameters give the same bytes. @throws InvalidArgument unless 0 < path_length_m <= 10 km and
/// 1 <= view_m <= 200
[[nodiscard]] Forest makeForest(const ForestParams& params);

/// A flight at walking pace along the lane: it sways as a drone does, no two poses are at the same place.
/// @param speed_m_s, frame_period_s  positive  @throws InvalidArgument, UnusableInput (no frames)
[[nodiscard]] Trajectory forestFlight(double speed_m_s, double frame_period_s, int frames);

inline constexpr double kOrbitRadius_m = 5;
/// Laps around the group in the clearing, kOrbitRadius_m from its middle and looking towards it. The height goes from
/// 1.5 to 6 m and back once in three laps; as above, the path sways.
/// @param speed_m_s, frame_period_s  positive  @throws InvalidArgument, UnusableInput (no frames)
[[nodiscard]] Trajectory forestOrbit(double speed_m_s, double frame_period_s, int frames);

}  // namespace accessvdb::sim
