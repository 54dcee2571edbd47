// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "accessvdb/region.h"

#include <algorithm>
#include <cstdio>
#include <iterator>
#include <map>
#include <utility>

#include "accessvdb/error.h"

namespace accessvdb {
namespace {

using Triangle = std::array<std::uint32_t, 3>;

[[noreturn]] void refuseMesh(const std::string& problem) {
  throw UnusableInput("region.mesh", "", problem, "Give a closed triangle mesh in the world frame, in metres");
}

/// Corners at the same place become one: files of separate triangles repeat them.
void joinCorners(const std::vector<Eigen::Vector3d>& vertices_W, std::vector<Triangle>& triangles) {
  std::map<std::array<double, 3>, std::uint32_t> first;
  std::vector<std::uint32_t> joined(vertices_W.size());
  for (std::uint32_t n = 0; n < vertices_W.size(); ++n) {
    const Eigen::Vector3d p_W = vertices_W[n] + Eigen::Vector3d::Zero();  // -0 becomes 0
    joined[n] = first.try_emplace({p_W.x(), p_W.y(), p_W.z()}, n).first->second;
  }
  for (Triangle& triangle : triangles) {
    for (std::uint32_t& corner : triangle) corner = joined[corner];
  }
  std::erase_if(triangles, [](const Triangle& t) { return t[0] == t[1] || t[1] == t[2] || t[2] == t[0]; });
}

/// Every edge is walked as often one way as the other: then the winding number of a place is well defined.
bool isClosed(const std::vector<Triangle>& triangles) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::int64_t> balance;
  for (const Triangle& t : triangles) {
    for (std::size_t n = 0; n < 3; ++n) {
      const std::uint32_t a = t[n], b = t[(n + 1) % 3];
      balance[std::minmax(a, b)] += a < b ? 1 : -1;
    }
  }
  return std::all_of(balance.begin(), balance.end(), [](const auto& edge) { return edge.second == 0; });
}

}  // namespace

Region Region::box(const Eigen::Vector3d& min_W, const Eigen::Vector3d& max_W) {
  if (!min_W.allFinite() || !max_W.allFinite() || !(min_W.array() <= max_W.array()).all()) {
    throw InvalidArgument("region.box", "Region::box",
                          "the corners of a box must be finite, none of the first above the second",
                          "Give XMIN,YMIN,ZMIN,XMAX,YMAX,ZMAX in the world frame, in metres");
  }
  Region region(Kind::Box);
  region.min_W_ = min_W;
  region.max_W_ = max_W;
  return region;
}

Region Region::mesh(std::vector<Eigen::Vector3d> vertices_W, std::vector<Triangle> triangles) {
  for (const Triangle& triangle : triangles) {
    for (const std::uint32_t corner : triangle) {
      if (corner >= vertices_W.size()) refuseMesh("a triangle has a corner that does not exist");
    }
  }
  for (const Eigen::Vector3d& p_W : vertices_W) {
    if (!p_W.allFinite()) refuseMesh("a corner of the mesh is not finite");
  }
  joinCorners(vertices_W, triangles);
  if (triangles.empty()) refuseMesh("the mesh has no triangle");
  if (!isClosed(triangles)) refuseMesh("the mesh is not closed, so nothing lies inside");
  Region region(Kind::Mesh);
  region.min_W_ = region.max_W_ = vertices_W[triangles.front()[0]];
  for (const Triangle& triangle : triangles) {
    for (const std::uint32_t corner : triangle) {
      region.min_W_ = region.min_W_.cwiseMin(vertices_W[corner]);
      region.max_W_ = region.max_W_.cwiseMax(vertices_W[corner]);
    }
  }
  region.vertices_W_ = std::move(vertices_W);
  region.triangles_ = std::move(triangles);
  return region;
}

Region Region::points(std::vector<std::uint32_t> ids) {
  if (ids.empty()) {
    throw InvalidArgument("region.empty", "", "a region of no points", "Name at least one point by its id");
  }
  std::sort(ids.begin(), ids.end());
  ids.erase(std::unique(ids.begin(), ids.end()), ids.end());
  Region region(Kind::Points);
  region.ids_ = std::move(ids);
  return region;
}

std::string Region::inWords() const {
  if (kind_ == Kind::Points) return std::to_string(ids_.size()) + (ids_.size() == 1 ? " point" : " points");
  if (kind_ == Kind::Mesh) return "mesh of " + std::to_string(triangles_.size()) + " triangles";
  char words[256];
  std::snprintf(words, sizeof words, "box %.10g %.10g %.10g to %.10g %.10g %.10g", min_W_.x(), min_W_.y(), min_W_.z(),
                max_W_.x(), max_W_.y(), max_W_.z());
  return words;
}

}  // namespace accessvdb
