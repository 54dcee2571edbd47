// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Tools in C.
#include <array>
#include <cstring>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/c_api.h"
#include "accessvdb/tool_geometry.h"
#include "accessvdb/tool_tables.h"
#include "capi/boundary.h"
#include "capi/handles.h"

namespace capi = accessvdb::capi;
using accessvdb::InvalidArgument;
using accessvdb::ToolGeometry;

namespace {

constexpr std::size_t kPoseBytes1 = 80;      ///< of the first version of accessvdb_tool_pose
constexpr std::size_t kToolInfoBytes1 = 56;  ///< of the first version of accessvdb_tool_info

std::optional<accessvdb::LengthUnit> unitFromC(std::int32_t unit) {
  using accessvdb::LengthUnit;
  constexpr std::array kUnits = {LengthUnit::Metre, LengthUnit::Centimetre, LengthUnit::Millimetre, LengthUnit::Inch};
  capi::requireChoice("unit", unit, ACCESSVDB_UNIT_FROM_FILE, ACCESSVDB_INCH);
  if (unit == ACCESSVDB_UNIT_FROM_FILE) return std::nullopt;
  return kUnits[static_cast<std::size_t>(unit - ACCESSVDB_METRE)];
}

accessvdb::ToolPose poseFromC(const accessvdb_tool_pose* given) {
  accessvdb::ToolPose pose;
  if (given == nullptr) return pose;
  const accessvdb_tool_pose c = capi::readSized("pose", given, kPoseBytes1, accessvdb_tool_pose{});
  if (capi::requireBool("pose.has_tip", c.has_tip)) pose.tip = Eigen::Vector3d(c.tip);
  const Eigen::Vector3d axis(c.axis), up(c.up), zero = Eigen::Vector3d::Zero();
  if (axis != zero) pose.axis = axis;
  if (up != zero) pose.up = up;
  return pose;
}

/// Makes a tool with `make` and returns it; *tool is NULL if that fails.
template <typename Make>
int createTool(accessvdb_tool** tool, accessvdb_error* error, const Make& make) noexcept {
  if (tool != nullptr) *tool = nullptr;
  return capi::guardedWithout(error, [&] {
    capi::requirePointer("tool", tool);
    *tool = std::make_unique<accessvdb_tool>(make()).release();
  });
}

}  // namespace

int accessvdb_tool_from_mesh(const char* path, std::int32_t unit, const accessvdb_tool_pose* pose,
                             accessvdb_tool** tool, accessvdb_error* error) noexcept {
  return createTool(tool, error, [&] {
    capi::requirePointer("path", path);
    return ToolGeometry::fromMesh(path, unitFromC(unit), poseFromC(pose));
  });
}

int accessvdb_tool_from_triangles(const float* vertices_T, std::size_t vertex_count, const std::uint32_t* triangles,
                                  std::size_t triangle_count, const char* name, accessvdb_tool** tool,
                                  accessvdb_error* error) noexcept {
  return createTool(tool, error, [&] {
    capi::requireArray("vertices_T", vertices_T, vertex_count, 3 * sizeof(float), alignof(float));
    capi::requireArray("triangles", triangles, triangle_count, 3 * sizeof(std::uint32_t), alignof(std::uint32_t));
    std::vector<Eigen::Vector3f> vertices(vertex_count);
    for (std::size_t n = 0; n < vertex_count; ++n) vertices[n] = Eigen::Vector3f(vertices_T + 3 * n);
    std::vector<std::array<std::uint32_t, 3>> corners(triangle_count);
    if (triangle_count > 0) std::memcpy(corners.data(), triangles, triangle_count * sizeof corners[0]);
    return ToolGeometry::fromTriangles(std::move(vertices), std::move(corners), name != nullptr ? name : "triangles");
  });
}

int accessvdb_tool_builtin(const char* name, accessvdb_tool** tool, accessvdb_error* error) noexcept {
  return createTool(tool, error, [&] {
    capi::requirePointer("name", name);
    return ToolGeometry::builtin(name);
  });
}

int accessvdb_tool_get_info(const accessvdb_tool* tool, accessvdb_tool_info* info) noexcept {
  accessvdb_error unread = {};
  return capi::guarded(unread, [&] {
    if (!capi::isTool(tool)) throw InvalidArgument("c_api.handle", "tool", "is not a tool");
    const std::size_t size = capi::checkedSize("info", info, kToolInfoBytes1);
    const ToolGeometry& geometry = tool->tool;
    accessvdb_tool_info out = {};
    out.watertight = geometry.watertight();
    out.vertex_count = geometry.vertices_T().size();
    out.triangle_count = geometry.triangles().size();
    Eigen::Map<Eigen::Vector3f>(out.min_T) = geometry.min_T();
    Eigen::Map<Eigen::Vector3f>(out.max_T) = geometry.max_T();
    out.reach_m = geometry.reach_m();
    capi::writeSized(info, size, out);
  });
}

double accessvdb_tool_opening_m(const accessvdb_tool* tool) noexcept {
  if (!capi::isTool(tool)) return std::numeric_limits<double>::quiet_NaN();
  try {
    return accessvdb::openingWidth_m(tool->tool);
  } catch (...) {  // no memory: not known to be closed
    return std::numeric_limits<double>::infinity();
  }
}

const char* accessvdb_tool_name(const accessvdb_tool* tool) noexcept {
  return capi::isTool(tool) ? tool->tool.name().c_str() : "";
}

const char* accessvdb_tool_sha256(const accessvdb_tool* tool) noexcept {
  return capi::isTool(tool) ? tool->tool.sha256().c_str() : "";
}

void accessvdb_tool_free(accessvdb_tool* tool) noexcept { capi::freeHandle(capi::isTool(tool), tool); }
