// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tool/surface_samples.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "tool/split_mix.h"

namespace accessvdb::internal {
namespace {

constexpr std::uint64_t kSeed = 20240131;

}  // namespace

std::vector<Eigen::Vector3d> sampleSurface(const std::vector<Eigen::Vector3f>& vertices,
                                           const std::vector<std::array<std::uint32_t, 3>>& triangles, int count) {
  std::vector<double> area_up_to;
  area_up_to.reserve(triangles.size());
  double area = 0;
  for (const auto& t : triangles) {
    const Eigen::Vector3d a = vertices[t[0]].cast<double>();
    area += (vertices[t[1]].cast<double>() - a).cross(vertices[t[2]].cast<double>() - a).norm();
    area_up_to.push_back(area);
  }
  std::vector<Eigen::Vector3d> samples;
  if (!(area > 0)) return samples;
  samples.reserve(std::size_t(count));
  SplitMix generator{kSeed};
  for (int n = 0; n < count; ++n) {
    const double target = generator.uniform() * area;
    const auto found = std::upper_bound(area_up_to.begin(), area_up_to.end() - 1, target) - area_up_to.begin();
    const auto& t = triangles[std::size_t(found)];
    const double root = std::sqrt(generator.uniform()), share = generator.uniform();
    samples.push_back((1 - root) * vertices[t[0]].cast<double>() + root * (1 - share) * vertices[t[1]].cast<double>() +
                      root * share * vertices[t[2]].cast<double>());
  }
  return samples;
}

}  // namespace accessvdb::internal
