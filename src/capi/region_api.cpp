// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Parts of a map taken out by hand, in C.
#include <Eigen/Core>
#include <array>
#include <cstring>
#include <utility>
#include <vector>

#include "accessvdb/c_api.h"
#include "accessvdb/what_if.h"
#include "capi/boundary.h"
#include "capi/handles.h"
#include "capi/points_out.h"

namespace capi = accessvdb::capi;
using accessvdb::Region;
using accessvdb::RemovedAs;

namespace {

// The numbers in C equal those in C++.
static_assert(ACCESSVDB_REGION_BOX == static_cast<int>(Region::Kind::Box));
static_assert(ACCESSVDB_REGION_MESH == static_cast<int>(Region::Kind::Mesh));
static_assert(ACCESSVDB_REGION_POINTS == static_cast<int>(Region::Kind::Points));
static_assert(ACCESSVDB_REMOVED_AS_FREE == static_cast<int>(RemovedAs::Free));
// Sizes of the first versions.
constexpr std::size_t kRegionBytes1 = sizeof(accessvdb_region);
constexpr std::size_t kRemovalBytes1 = sizeof(accessvdb_removal);
constexpr std::size_t kWhatIfBytes1 = sizeof(accessvdb_what_if);

Region meshFromC(const accessvdb_region& c) {
  capi::requireArray("vertices_W", c.vertices_W, c.vertex_count, 3 * sizeof(double), alignof(double));
  capi::requireArray("triangles", c.triangles, c.triangle_count, 3 * sizeof(std::uint32_t), alignof(std::uint32_t));
  std::vector<Eigen::Vector3d> vertices_W(c.vertex_count);
  for (std::size_t n = 0; n < c.vertex_count; ++n) vertices_W[n] = Eigen::Vector3d(c.vertices_W + 3 * n);
  std::vector<std::array<std::uint32_t, 3>> triangles(c.triangle_count);
  for (std::size_t n = 0; n < c.triangle_count; ++n)
    std::memcpy(&triangles[n], c.triangles + 3 * n, sizeof triangles[n]);
  return Region::mesh(std::move(vertices_W), std::move(triangles));
}

Region regionFromC(const accessvdb_region& c) {
  switch (capi::requireChoice("kind", c.kind, ACCESSVDB_REGION_BOX, ACCESSVDB_REGION_POINTS)) {
    case ACCESSVDB_REGION_BOX:
      return Region::box(Eigen::Vector3d(c.min_W), Eigen::Vector3d(c.max_W));
    case ACCESSVDB_REGION_MESH:
      return meshFromC(c);
    default:
      capi::requireArray("ids", c.ids, c.id_count, sizeof(std::uint32_t), alignof(std::uint32_t));
      return Region::points(std::vector<std::uint32_t>(c.ids, c.ids + c.id_count));
  }
}

/// @param size  of each, of the caller's version
std::vector<Region> regionsFromC(const accessvdb_region* regions, std::size_t size, std::size_t count) {
  capi::requireSize("region_size", size, kRegionBytes1);
  capi::requireArray("regions", regions, count, size, alignof(accessvdb_region));
  std::vector<Region> all;
  const auto* bytes = reinterpret_cast<const unsigned char*>(regions);
  for (std::size_t n = 0; n < count; ++n, bytes += size) {
    accessvdb_region region;
    std::memcpy(&region, bytes, sizeof region);
    if (size > sizeof region) capi::requireZero("region", bytes + sizeof region, bytes + size);
    all.push_back(regionFromC(region));
  }
  return all;
}

}  // namespace

int accessvdb_field_remove_region(accessvdb_field* field, const accessvdb_region* region, std::size_t region_size,
                                  std::int32_t removed_as, accessvdb_removal* removal) noexcept {
  return capi::onField(field, [&] {
    const std::size_t room = removal == nullptr ? 0 : capi::checkedSize("removal", removal, kRemovalBytes1);
    capi::requireChoice("removed_as", removed_as, ACCESSVDB_REMOVED_AS_UNKNOWN, ACCESSVDB_REMOVED_AS_FREE);
    const std::vector<Region> regions = regionsFromC(region, region_size, 1);
    const accessvdb::Removal done = field->field.removeRegion(regions[0], static_cast<RemovedAs>(removed_as));
    accessvdb_removal c = {};
    c.removed_as = removed_as;
    c.voxels = done.voxels;
    c.colliding_voxels = done.colliding_voxels;
    c.points = done.points;
    c.flipped_voxels = done.flipped_voxels;
    if (room > 0) capi::writeSized(removal, room, c);
  });
}

int accessvdb_field_what_if(accessvdb_field* field, const accessvdb_region* regions, std::size_t region_size,
                            std::size_t region_count, accessvdb_what_if* what_if) noexcept {
  return capi::onField(field, [&] {
    const std::size_t room = what_if == nullptr ? 0 : capi::checkedSize("what_if", what_if, kWhatIfBytes1);
    accessvdb::WhatIf found = field->field.whatIf(regionsFromC(regions, region_size, region_count));
    accessvdb_what_if c = {};
    c.opens = found.opens.size();
    c.voxels = found.voxels;
    c.colliding_voxels = found.colliding_voxels;
    c.points_gone = found.points_gone;
    c.points_tried = found.points_tried;
    c.direction_tests = found.direction_tests;
    c.choose_ms = found.choose_ms;
    c.score_ms = found.score_ms;
    field->opened = std::move(found.opens);
    if (room > 0) capi::writeSized(what_if, room, c);
  });
}

int accessvdb_field_copy_opened(accessvdb_field* field, std::size_t first, std::size_t count, accessvdb_point* points,
                                std::size_t point_size) noexcept {
  return capi::onField(field, [&] { capi::copyPoints(field->opened, {first, count}, points, point_size); });
}
