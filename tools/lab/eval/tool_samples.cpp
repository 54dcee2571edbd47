// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "eval/tool_samples.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace accessvdb::eval {
namespace {

/// PCG32 (O'Neill 2014), one of the simplest generators that pass the usual statistical tests; not the one of src/tool.
class Pcg32 {
 public:
  explicit Pcg32(std::uint64_t seed) : state_(seed + kIncrement) { (void)next(); }

  double uniform() { return (next() + 0.5) * 0x1p-32; }  ///< (0, 1)

 private:
  static constexpr std::uint64_t kIncrement = 1442695040888963407u;

  std::uint32_t next() {
    const std::uint64_t old = state_;
    state_ = old * 6364136223846793005u + kIncrement;
    const auto mixed = static_cast<std::uint32_t>(((old >> 18) ^ old) >> 27);
    const auto turn = static_cast<std::uint32_t>(old >> 59);
    return (mixed >> turn) | (mixed << ((32 - turn) & 31));
  }

  std::uint64_t state_;
};

}  // namespace

std::vector<Eigen::Vector3d> sampleToolSurface(const ToolGeometry& tool, int count, std::uint64_t seed) {
  const auto corner = [&tool](std::uint32_t vertex) -> Eigen::Vector3d {
    return tool.vertices_T()[vertex].cast<double>();
  };
  std::vector<double> area_up_to;
  double area = 0;
  for (const auto& [a, b, c] : tool.triangles()) {
    area += 0.5 * (corner(b) - corner(a)).cross(corner(c) - corner(a)).norm();
    area_up_to.push_back(area);
  }
  Pcg32 random(seed);
  std::vector<Eigen::Vector3d> samples;
  samples.reserve(static_cast<std::size_t>(count));
  while (samples.size() < static_cast<std::size_t>(count) && area > 0) {
    const auto at = std::lower_bound(area_up_to.begin(), area_up_to.end(), random.uniform() * area);
    const auto& [a, b, c] =
        tool.triangles()[static_cast<std::size_t>(std::min(at, area_up_to.end() - 1) - area_up_to.begin())];
    // Uniform in a triangle: fold the square's far half back (Turk, Graphics Gems 1990).
    double u = random.uniform(), w = random.uniform();
    if (u + w > 1) u = 1 - u, w = 1 - w;
    samples.push_back(corner(a) + u * (corner(b) - corner(a)) + w * (corner(c) - corner(a)));
  }
  return samples;
}

}  // namespace accessvdb::eval
