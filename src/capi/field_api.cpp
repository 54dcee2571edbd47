// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Fields in C.
#include <Eigen/Core>
#include <algorithm>
#include <cstring>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/c_api.h"
#include "capi/boundary.h"
#include "capi/handles.h"
#include "capi/params_from_c.h"
#include "capi/points_out.h"
#include "capi/update_stats_out.h"

namespace capi = accessvdb::capi;
using accessvdb::AccessibilityField;
using accessvdb::InvalidArgument;
using accessvdb::SurfacePoint;
using accessvdb::UnusableInput;
using accessvdb::capi::onField;

namespace {

// Sizes of the first versions.
constexpr std::size_t kPointBytes1 = 80;
constexpr std::size_t kFrameStatsBytes1 = 112;
constexpr std::size_t kCountsBytes1 = 96;
static_assert(sizeof(accessvdb_point) >= kPointBytes1 && sizeof(accessvdb_frame_stats) >= kFrameStatsBytes1 &&
              sizeof(accessvdb_counts) >= kCountsBytes1);
// Arrays of three numbers are read as Eigen's vectors in place.
static_assert(sizeof(Eigen::Vector3f) == 3 * sizeof(float) && alignof(Eigen::Vector3f) == alignof(float));
static_assert(sizeof(Eigen::Vector3d) == 3 * sizeof(double) && alignof(Eigen::Vector3d) == alignof(double));

template <typename Scalar>
auto vectors(const char* name, const Scalar* xyz, std::size_t count) {
  using Vector = Eigen::Matrix<Scalar, 3, 1>;
  capi::requireArray(name, xyz, count, sizeof(Vector), alignof(Scalar));
  return std::span<const Vector>(reinterpret_cast<const Vector*>(xyz), count);
}

/// @param T_W_S  [16] row-major
Eigen::Isometry3d poseFromC(const double* T_W_S) {
  capi::requireArray("T_W_S", T_W_S, 16, sizeof(double), alignof(double));
  Eigen::Isometry3d pose;
  pose.matrix() = Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(T_W_S);
  if (pose.matrix().row(3) != Eigen::RowVector4d(0, 0, 0, 1)) {
    if (!pose.matrix().allFinite()) {
      throw UnusableInput("pose.last_row", "T_W_S", "the pose is not finite",
                          "Leave out scans whose pose is not known");
    }
    throw UnusableInput("pose.last_row", "T_W_S", "the last row of a pose is not 0 0 0 1",
                        "Pass the matrix row by row; in a transposed one the position is there");
  }
  return pose;
}

accessvdb_point pointToC(const SurfacePoint& p) {
  accessvdb_point c = {};
  Eigen::Map<Eigen::Vector3d>(c.position_W) = p.position_W;
  Eigen::Map<Eigen::Vector3f>(c.normal_W) = p.normal_W;
  Eigen::Map<Eigen::Vector3f>(c.direction_W) = p.direction_W;
  c.yaw_rad = p.yaw_rad;
  c.weight = p.weight;
  c.confidence = p.confidence;
  c.stability = p.stability;
  c.id = p.id;
  c.direction = p.direction;
  c.score = p.score;
  c.label = static_cast<std::uint8_t>(p.label);
  c.reason = static_cast<std::uint8_t>(p.reason);
  c.confident = p.confident;
  c.roll = p.roll;
  c.tool = p.tool;
  c.tools = p.tools;
  const Eigen::Quaternionf& q = p.orientation_WT;
  const float wxyz[4] = {q.w(), q.x(), q.y(), q.z()};
  std::copy_n(wxyz, 4, c.orientation_WT);
  return c;
}

/// Writes a point of the caller's version.
void writePoint(void* out, std::size_t size, const SurfacePoint& point) { capi::writeRow(out, size, pointToC(point)); }

/// Size given by the caller; 0 for no struct.
template <typename Struct>
std::size_t optionalSize(const char* name, const Struct* out, std::size_t least) {
  return out == nullptr ? 0 : capi::checkedSize(name, out, least);
}

void writeStats(accessvdb_frame_stats* out, std::size_t size, const accessvdb::FrameStats& stats) {
  if (size == 0) return;
  accessvdb_frame_stats c = {};
  c.points_in = stats.points_in;
  c.points_used = stats.points_used;
  std::copy(stats.dropped.begin(), stats.dropped.end(), c.dropped);
  c.touched_leaves = stats.touched_leaves;
  c.new_leaves = stats.new_leaves;
  c.distance_updates = stats.distance_updates;
  c.cleared_updates = stats.cleared_updates;
  c.integrate_ms = stats.integrate_ms;
  c.mirror_ms = stats.mirror_ms;
  capi::writeSized(out, size, c);
}

void requireName(const char* file) {
  capi::requirePointer("file", file);
  if (*file == '\0') throw InvalidArgument("c_api.value", "file", "is empty", "Name the file of the state");
}

std::span<const std::int32_t> valuesOf(const std::int32_t* attributes, std::size_t count) {
  capi::requireArray("attributes", attributes, count, sizeof(std::int32_t), alignof(std::int32_t));
  return {attributes, count};
}

const accessvdb::FieldSnapshot& snapshotOf(const accessvdb_field* field) {
  if (field->snapshot) return *field->snapshot;
  throw InvalidArgument("snapshot.none", "", "no snapshot has been taken", "Call accessvdb_field_take_snapshot first");
}

}  // namespace

void accessvdb::capi::copyPoints(const std::vector<SurfacePoint>& all, const PointRange& range, accessvdb_point* points,
                                 std::size_t point_size) {
  const auto [first, count] = range;
  requireSize("point_size", point_size, kPointBytes1);
  requireArray("points", points, count, point_size, alignof(accessvdb_point));
  if (first > all.size() || count > all.size() - first) {
    throw InvalidArgument(
        "snapshot.range", "",
        std::to_string(count) + " points from " + std::to_string(first) + " on, of " + std::to_string(all.size()),
        "The call that found them returns their number");
  }
  auto* out = reinterpret_cast<unsigned char*>(points);
  for (std::size_t n = 0; n < count; ++n) writePoint(out + n * point_size, point_size, all[first + n]);
}

int accessvdb_params_defaults(accessvdb_params* params) noexcept {
  accessvdb_error unread = {};
  return capi::guarded(unread, [&] {
    const std::size_t size = capi::checkedSize("params", params, capi::kParamsBytes1);
    capi::writeSized(params, size, capi::paramsToC({}));
  });
}

int accessvdb_params_paper(double voxel_size_m, accessvdb_params* params) noexcept {
  accessvdb_error unread = {};
  return capi::guarded(unread, [&] {
    const std::size_t size = capi::checkedSize("params", params, capi::kParamsBytes1);
    const accessvdb::FieldParams paper = accessvdb::FieldParams::paper(voxel_size_m);
    static_cast<void>(paper.resolved());  // checks the voxel size early
    capi::writeSized(params, size, capi::paramsToC(paper));
  });
}

int accessvdb_field_create(const accessvdb_tool* tool, const accessvdb_params* params, accessvdb_field** field,
                           accessvdb_error* error) noexcept {
  if (field != nullptr) *field = nullptr;
  return capi::guardedWithout(error, [&] {
    capi::requirePointer("field", field);
    if (!capi::isTool(tool)) throw InvalidArgument("c_api.handle", "tool", "is not a tool", "Make one first");
    accessvdb::FieldParams given;
    if (params != nullptr) {
      given = capi::paramsFromC(capi::readSized("params", params, capi::kParamsBytes1, capi::paramsToC({})));
    }
    *field = std::make_unique<accessvdb_field>(AccessibilityField(tool->tool, given)).release();
  });
}

void accessvdb_field_free(accessvdb_field* field) noexcept {
  if (!capi::isField(field)) return;
  field->mark = capi::kFreedMark;
  delete field;
}

const char* accessvdb_field_error_text(const accessvdb_field* field) noexcept {
  return capi::isField(field) ? field->error.text : "this is not a field. Make one with accessvdb_field_create.";
}

const char* accessvdb_field_error_id(const accessvdb_field* field) noexcept {
  return capi::isField(field) ? field->error.id : "c_api.handle";
}

int accessvdb_field_integrate_scan(accessvdb_field* field, const float* points_S, std::size_t point_count,
                                   const double* T_W_S, accessvdb_frame_stats* stats) noexcept {
  return onField(field, [&] {
    const std::size_t size = optionalSize("stats", stats, kFrameStatsBytes1);
    const auto points = vectors("points_S", points_S, point_count);
    writeStats(stats, size, field->field.integrateScan(points, poseFromC(T_W_S)));
  });
}

int accessvdb_field_integrate_scan_at(accessvdb_field* field, const float* points_S, std::size_t point_count,
                                      const double* T_W_S, double stamp_s, accessvdb_frame_stats* stats) noexcept {
  return onField(field, [&] {
    const std::size_t size = optionalSize("stats", stats, kFrameStatsBytes1);
    const auto points = vectors("points_S", points_S, point_count);
    writeStats(stats, size, field->field.integrateScan(points, poseFromC(T_W_S), stamp_s));
  });
}

int accessvdb_field_integrate_rays(accessvdb_field* field, const double* points_W, std::size_t point_count,
                                   const double* origins_W, std::size_t origin_count,
                                   accessvdb_frame_stats* stats) noexcept {
  return onField(field, [&] {
    const std::size_t size = optionalSize("stats", stats, kFrameStatsBytes1);
    const auto points = vectors("points_W", points_W, point_count);
    writeStats(stats, size, field->field.integrateRays(points, vectors("origins_W", origins_W, origin_count)));
  });
}

int accessvdb_field_integrate_rays_at(accessvdb_field* field, const double* points_W, std::size_t point_count,
                                      const double* origins_W, std::size_t origin_count, double stamp_s,
                                      accessvdb_frame_stats* stats) noexcept {
  return onField(field, [&] {
    const std::size_t size = optionalSize("stats", stats, kFrameStatsBytes1);
    const auto points = vectors("points_W", points_W, point_count);
    const auto origins = vectors("origins_W", origins_W, origin_count);
    writeStats(stats, size, field->field.integrateRays(points, origins, stamp_s));
  });
}

int accessvdb_field_integrate_scan_carrying(accessvdb_field* field, const float* points_S, std::size_t point_count,
                                            const double* T_W_S, double stamp_s, const std::int32_t* attributes,
                                            std::size_t attribute_count, accessvdb_frame_stats* stats) noexcept {
  return onField(field, [&] {
    const std::size_t size = optionalSize("stats", stats, kFrameStatsBytes1);
    const auto points = vectors("points_S", points_S, point_count);
    const auto values = valuesOf(attributes, attribute_count);
    writeStats(stats, size, field->field.integrateScan(points, poseFromC(T_W_S), stamp_s, values));
  });
}

int accessvdb_field_integrate_rays_carrying(accessvdb_field* field, const double* points_W, std::size_t point_count,
                                            const double* origins_W, std::size_t origin_count, double stamp_s,
                                            const std::int32_t* attributes, std::size_t attribute_count,
                                            accessvdb_frame_stats* stats) noexcept {
  return onField(field, [&] {
    const std::size_t size = optionalSize("stats", stats, kFrameStatsBytes1);
    const auto points = vectors("points_W", points_W, point_count);
    const auto origins = vectors("origins_W", origins_W, origin_count);
    const auto values = valuesOf(attributes, attribute_count);
    writeStats(stats, size, field->field.integrateRays(points, origins, stamp_s, values));
  });
}

int accessvdb_field_copy_attribute(accessvdb_field* field, std::size_t column, std::size_t first, std::size_t count,
                                   std::int32_t* values) noexcept {
  return onField(field, [&] {
    const std::vector<accessvdb::AttributeColumn>& columns = snapshotOf(field).attributes;
    if (column >= columns.size()) {
      throw InvalidArgument("carry.column", std::to_string(column),
                            "is not one of the " + std::to_string(columns.size()) + " attributes of this field",
                            "Count the names in accessvdb_params::carry from 0");
    }
    const std::vector<std::int32_t>& all = columns[column].values;
    capi::requireArray("values", values, count, sizeof(std::int32_t), alignof(std::int32_t));
    if (first > all.size() || count > all.size() - first) {
      throw InvalidArgument(
          "snapshot.range", "",
          std::to_string(count) + " points from " + std::to_string(first) + " on, of " + std::to_string(all.size()),
          "Stay within the snapshot");
    }
    std::copy_n(all.begin() + static_cast<std::ptrdiff_t>(first), count, values);
  });
}

int accessvdb_field_latest_stamp(accessvdb_field* field, double* stamp_s) noexcept {
  return onField(field, [&] {
    capi::requirePointer("stamp_s", stamp_s);
    *stamp_s = field->field.latestStamp_s().value_or(std::numeric_limits<double>::quiet_NaN());
  });
}

int accessvdb_field_tool_share_hidden(accessvdb_field* field, double* share) noexcept {
  return onField(field, [&] {
    capi::requirePointer("share", share);
    *share = field->field.toolShareHidden();
  });
}

int accessvdb_field_update(accessvdb_field* field, accessvdb_update_stats* stats) noexcept {
  return onField(field, [&] {
    const capi::UpdateStatsOut out(stats);
    out.write(field->field.update());
  });
}

int accessvdb_field_take_snapshot(accessvdb_field* field, std::size_t* point_count) noexcept {
  if (point_count != nullptr) *point_count = 0;
  return onField(field, [&] {
    field->snapshot.reset();  // avoids two at once
    field->snapshot = field->field.snapshot();
    if (point_count != nullptr) *point_count = field->snapshot->points.size();
  });
}

int accessvdb_field_copy_points(accessvdb_field* field, std::size_t first, std::size_t count, accessvdb_point* points,
                                std::size_t point_size) noexcept {
  return onField(field, [&] { capi::copyPoints(snapshotOf(field).points, {first, count}, points, point_size); });
}

int accessvdb_field_get_counts(accessvdb_field* field, accessvdb_counts* counts) noexcept {
  return onField(field, [&] {
    const std::size_t size = capi::checkedSize("counts", counts, kCountsBytes1);
    const accessvdb::FieldSnapshot& snapshot = snapshotOf(field);
    accessvdb_counts c = {};
    c.points = snapshot.points.size();
    for (const SurfacePoint& point : snapshot.points) {
      ++c.labels[static_cast<std::size_t>(point.label)];
      ++(point.reason == accessvdb::PointReason::Changed ? c.changed
                                                         : c.reasons[static_cast<std::size_t>(point.reason)]);
    }
    capi::writeSized(counts, size, c);
  });
}

int accessvdb_field_drop_snapshot(accessvdb_field* field) noexcept {
  return onField(field, [&] { field->snapshot.reset(); });
}

int accessvdb_field_point_at(accessvdb_field* field, const double* p_W, accessvdb_point* point, std::size_t point_size,
                             std::int32_t* found) noexcept {
  if (found != nullptr) *found = 0;
  return onField(field, [&] {
    capi::requirePointer("found", found);
    capi::requireArray("p_W", p_W, 3, sizeof(double), alignof(double));
    capi::requireSize("point_size", point_size, kPointBytes1);
    capi::requirePointer("point", point);
    const std::optional<SurfacePoint> answer = field->field.pointAt(Eigen::Vector3d(p_W));
    if (!answer) return;
    writePoint(point, point_size, *answer);
    *found = 1;
  });
}

const char* accessvdb_field_device(const accessvdb_field* field) noexcept {
  return capi::isField(field) ? field->device.c_str() : "";
}

const char* accessvdb_field_parameters(const accessvdb_field* field) noexcept {
  return capi::isField(field) ? field->parameters.c_str() : "";
}

int accessvdb_field_write(accessvdb_field* field, const char* folder) noexcept {
  return onField(field, [&] {
    capi::requirePointer("folder", folder);
    if (*folder == '\0') throw InvalidArgument("c_api.value", "folder", "is empty", "Name the output folder");
    field->field.write(folder);
  });
}

int accessvdb_field_save_state(accessvdb_field* field, const char* file) noexcept {
  return onField(field, [&] {
    requireName(file);
    field->field.saveState(file);
  });
}

int accessvdb_field_load_state(const char* file, const accessvdb_tool* tool, std::int32_t backend, std::int32_t threads,
                               accessvdb_field** field, accessvdb_error* error) noexcept {
  if (field != nullptr) *field = nullptr;
  return capi::guardedWithout(error, [&] {
    capi::requirePointer("field", field);
    requireName(file);
    if (!capi::isTool(tool)) throw InvalidArgument("c_api.handle", "tool", "is not a tool", "Make one first");
    const accessvdb::BackendKind kind = capi::backendFromC(backend);
    *field =
        std::make_unique<accessvdb_field>(AccessibilityField::loadState(file, tool->tool, kind, threads)).release();
  });
}
