// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Points as the page holds them: in blocks of columns, each byte of a column in a plane of its own, compressed. A
/// point takes 5 to 7 bytes.
///
/// A block of n points is, in this order (src/report/page/points.js reads it):
///   id          4 planes, low byte first: what it is more than the id before it, less 1 (ids begin at -1)
///   x, y, z     4 planes each: steps from the position before it, first the block's base; zigzag (0, -1, 1, -2 ...)
///   state       1 plane: label + 4 reason
///   direction   2 planes: index in the list of directions; 65535 = none
///   score       2 planes; 65535 = none
///   confidence  1 plane: 255 is 1
///   normal      1 plane: the octahedron unfolded onto a square of 15 x 15 cells, 15 v + u; 255 = none.
///                       That is within 18 degrees, and for shading only
/// and with several tools
///   tool        1 plane: index of the one that stands for the point
///   tools       4 planes: bit k is set if tool k reaches it
/// and, behind those, where points have one
///   probability 1 plane: half percents, 0 to 200; 255 = nothing is said
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "accessvdb/types.h"

namespace accessvdb::internal {

struct PackedBlock {
  std::string tile;
  std::uint32_t points = 0;
  std::array<std::int64_t, 3> base = {};  ///< position of the first point, in steps from the origin
  std::string base64;                     ///< of the compressed columns
};

class PointPacker {
 public:
  static constexpr std::size_t kPointsPerBlock = 1 << 16;

  /// @param step_m  positions are rounded to multiples of it
  /// @param several_tools  the field has more than one
  /// @param probability  its points have SurfacePoint::access_probability
  /// @param write   called for each block when it is complete
  PointPacker(const Eigen::Vector3d& origin_W, double step_m, bool several_tools, bool probability,
              std::function<void(PackedBlock)> write);

  /// Points of a tile come one after the other, with rising ids.
  /// @throws InputError for a position that is more than 2^30 steps away, or too many directions
  void add(const std::string& tile, const SurfacePoint& point);
  /// Writes what is left.
  void finish();
  /// The directions that points refer to, in the order of their first points. Unit vectors.
  [[nodiscard]] const std::vector<Eigen::Vector3f>& directions_W() const { return directions_W_; }
  /// Of each, where the tool's +z points. Directions with another one are listed again.
  [[nodiscard]] const std::vector<Eigen::Vector3f>& ups_W() const { return ups_W_; }

 private:
  std::uint16_t indexOf(const SurfacePoint& point);
  void startBlock(const std::string& tile, const SurfacePoint& point);
  [[nodiscard]] std::array<std::int64_t, 3> stepsOf(const Eigen::Vector3d& p_W) const;

  Eigen::Vector3d origin_W_;
  double step_m_;
  bool several_tools_, probability_;
  std::function<void(PackedBlock)> write_;
  PackedBlock block_;
  std::int64_t last_id_ = -1;
  std::array<std::int64_t, 3> last_ = {};
  std::vector<std::string> planes_;
  std::vector<Eigen::Vector3f> directions_W_, ups_W_;
  std::map<std::array<float, 7>, std::uint16_t> index_of_;
};

/// Of the normal in a byte, as above.
[[nodiscard]] std::uint8_t octahedralByte(const Eigen::Vector3f& normal);

}  // namespace accessvdb::internal
