// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "sim/mesh_distance.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>
#include <vector>

#include "accessvdb/error.h"
#include "sim/closed_mesh.h"
#include "sim/embree.h"
#include "sim/nearest_on_triangle.h"

namespace accessvdb::sim {
namespace {

/// Float coordinates, float rays and float boxes are off by a few units in the last place (2^-24 = 6e-8 of the largest
/// coordinate, measured from the middle of the mesh); eight of them are safely more than that.
constexpr double kFloatRounding = 5e-7;

/// Directions of the inside test. Exact in float, none near an axis, a face or a space diagonal, so that meshes aligned
/// with those are not grazed; the next one is tried if a ray comes too near to an edge to be counted.
const std::array<Eigen::Vector3f, 8> kDirections = {
    Eigen::Vector3f(0.8125f, 0.421875f, 0.265625f),    Eigen::Vector3f(-0.71875f, 0.578125f, 0.328125f),
    Eigen::Vector3f(-0.453125f, -0.796875f, 0.34375f), Eigen::Vector3f(0.640625f, -0.671875f, 0.296875f),
    Eigen::Vector3f(0.234375f, 0.359375f, 0.90625f),   Eigen::Vector3f(0.390625f, 0.765625f, -0.515625f),
    Eigen::Vector3f(-0.859375f, 0.15625f, -0.421875f), Eigen::Vector3f(0.171875f, -0.890625f, 0.46875f)};

/// State of a closest-point query.
struct Nearest {
  const TriangleMesh* mesh;
  Eigen::Vector3d p_W;
  double slack_m;       ///< triangles up to this much farther than the best are still examined
  double distance2_m2;  ///< squared distance of the best so far
  Eigen::Vector3d best_W;
  std::uint32_t triangle;
  std::vector<std::uint32_t>* touching;  ///< every triangle examined within the slack, or null
};

/// State of an inside test; Embree passes the context to the filter.
struct Crossings {
  RayContext context;  // first: the filter gets a pointer to it
  const TriangleMesh* mesh;
  Eigen::Vector3d p_W, direction;
  double edge_margin_m;
  int winding;
  bool near_edge;
};

/// Counts the hit and continues. Everything is recomputed in double: Embree only proposes triangles.
void countCrossing(const RTCFilterFunctionNArguments* arguments) {
  auto& crossings = *reinterpret_cast<Crossings*>(arguments->context);
  arguments->valid[0] = 0;  // rejected, so that the ray continues
  const std::uint32_t id = RTCHitN_primID(arguments->hit, 1, 0);
  const auto& triangle = crossings.mesh->triangles[id];
  const auto vertex = [&](int k) -> Eigen::Vector3d {
    return crossings.mesh->vertices_W[triangle[std::size_t(k)]].cast<double>() - crossings.p_W;
  };
  const std::array<Eigen::Vector3d, 3> corner = {vertex(0), vertex(1), vertex(2)};
  const Eigen::Vector3d& direction = crossings.direction;
  int positive = 0, negative = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    const Eigen::Vector3d& a = corner[k];
    const Eigen::Vector3d& b = corner[(k + 1) % 3];
    // Seen along the ray: twice the signed area of (ray, a, b) = length of the edge x distance of its line from the
    // ray.
    const double area = direction.dot(a.cross(b)), length = direction.cross(b - a).norm() / direction.norm();
    if (std::abs(area) / direction.norm() <= crossings.edge_margin_m * length) {
      crossings.near_edge = true;
      return;
    }
    (area > 0 ? positive : negative) += 1;
  }
  if (positive > 0 && negative > 0) return;  // the ray misses the triangle
  const Eigen::Vector3d normal = (corner[1] - corner[0]).cross(corner[2] - corner[0]);
  const double facing = direction.dot(normal);
  if (corner[0].dot(normal) * facing < 0) return;  // behind the point
  crossings.winding += facing > 0 ? 1 : -1;
}

bool visitTriangle(RTCPointQueryFunctionArguments* arguments) {
  auto& nearest = *static_cast<Nearest*>(arguments->userPtr);
  const Eigen::Vector3d found = nearestOnTriangle(*nearest.mesh, arguments->primID, nearest.p_W);
  const double distance2_m2 = (found - nearest.p_W).squaredNorm();
  if (nearest.touching) nearest.touching->push_back(arguments->primID);
  // Ties go to the lower triangle index, so that the answer does not depend on the tree's order.
  if (!(distance2_m2 < nearest.distance2_m2 ||
        (distance2_m2 == nearest.distance2_m2 && arguments->primID < nearest.triangle)))
    return false;
  nearest.distance2_m2 = distance2_m2;
  nearest.best_W = found;
  nearest.triangle = arguments->primID;
  const float radius_m = float((std::sqrt(distance2_m2) + nearest.slack_m) * (1 + kFloatRounding));
  if (!(radius_m < arguments->query->radius)) return false;
  arguments->query->radius = radius_m;
  return true;
}

class MeshDistance final : public SignedDistance {
 public:
  explicit MeshDistance(const TriangleMesh& mesh) : mesh_(mesh) {
    for (const auto& vertex : mesh_.vertices_W) box_W_.extend(vertex.cast<double>());
    middle_W_ = box_W_.center();
    rounding_m_ = kFloatRounding * box_W_.diagonal().norm();
    device_ = rtcNewDevice(nullptr);
    if (!device_) throw InternalError("simulation.embree", "Embree", "cannot be started");
    scene_ = rtcNewScene(device_);
    rtcSetSceneFlags(scene_, RTC_SCENE_FLAG_ROBUST);  // a ray through a shared edge hits at least one of the two
    const RTCGeometry geometry = rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_TRIANGLE);
    // Embree reads 16 bytes per vertex: uses its own buffer, with room after the last one.
    auto* vertices = static_cast<float*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                                                 3 * sizeof(float), mesh_.vertices_W.size()));
    auto* indices = static_cast<std::uint32_t*>(rtcSetNewGeometryBuffer(
        geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 3 * sizeof(std::uint32_t), mesh_.triangles.size()));
    if (!vertices || !indices) {
      rtcReleaseGeometry(geometry);
      release();
      throw ResourceLimit("simulation.memory", "mesh", "is too large for the memory", "Use fewer triangles");
    }
    for (const auto& vertex : mesh_.vertices_W)
      vertices = std::copy_n(local(vertex.cast<double>()).data(), 3, vertices);
    for (const auto& triangle : mesh_.triangles) indices = std::copy_n(triangle.data(), 3, indices);
    rtcSetGeometryOccludedFilterFunction(geometry, countCrossing);
    rtcSetGeometryPointQueryFunction(geometry, visitTriangle);
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene_, geometry);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(scene_);
    if (rtcGetDeviceError(device_) != RTC_ERROR_NONE) {
      release();
      throw ResourceLimit("simulation.memory", "mesh", "cannot be indexed by Embree", "Use fewer triangles");
    }
  }
  ~MeshDistance() override { release(); }
  MeshDistance(const MeshDistance&) = delete;
  MeshDistance& operator=(const MeshDistance&) = delete;

  double at(const Eigen::Vector3d& p_W) const override {
    if (!p_W.allFinite()) return -std::numeric_limits<double>::infinity();  // bad data collides
    const double distance_m = std::sqrt(nearest(p_W, kAnywhere, 0, nullptr).distance2_m2);
    return winding(p_W) > 0 ? -distance_m : distance_m;
  }

  bool surfaceNearerThan(const Eigen::Vector3d& p_W, double r_m) const override {
    if (!p_W.allFinite()) return true;
    if (!(r_m > 0)) return false;
    return std::sqrt(nearest(p_W, r_m, 0, nullptr).distance2_m2) < r_m;
  }

  Eigen::Vector3d outwardNormal(const Eigen::Vector3d& p_W) const override {
    std::vector<std::uint32_t> touching;
    const Nearest found = nearest(p_W, kAnywhere, 2 * rounding_m_, &touching);
    const Eigen::Vector3d away = p_W - found.best_W;
    if (away.norm() > 4 * rounding_m_) return away.normalized() * (winding(p_W) > 0 ? -1.0 : 1.0);
    // On the surface: weights the triangles that meet there by their angle, independently of the tessellation.
    std::sort(touching.begin(), touching.end());
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const std::uint32_t triangle : touching) {
      const Eigen::Vector3d here = nearestOnTriangle(mesh_, triangle, p_W);
      if ((here - p_W).norm() > std::sqrt(found.distance2_m2) + 2 * rounding_m_) continue;
      sum += angleFilled(mesh_, triangle, here, 2 * rounding_m_) * triangleNormal(mesh_, triangle);
    }
    return sum.norm() > 0 ? Eigen::Vector3d(sum.normalized()) : triangleNormal(mesh_, found.triangle);
  }

  double errorBound_m() const override { return 0; }

  /// Signed crossings of a ray, so that each overlapping part counts.
  int winding(const Eigen::Vector3d& p_W) const {
    if (!box_W_.contains(p_W)) return 0;
    // Tries the shortest way out of the box first: it meets the fewest triangles.
    std::array<std::size_t, kDirections.size()> order;
    std::array<double, kDirections.size()> exit_m;
    for (std::size_t n = 0; n < kDirections.size(); ++n) {
      const Eigen::Vector3d direction = kDirections[n].cast<double>();
      const Eigen::Array3d wall = (direction.array() > 0).select(box_W_.max().array(), box_W_.min().array());
      exit_m[n] = ((wall - p_W.array()) / direction.array()).minCoeff();
      order[n] = n;
    }
    std::sort(order.begin(), order.end(),
              [&](std::size_t a, std::size_t b) { return std::pair(exit_m[a], a) < std::pair(exit_m[b], b); });
    for (const std::size_t n : order) {
      bool near_edge = false;
      const int count = crossings(p_W, kDirections[n], near_edge);
      if (!near_edge) return count;
    }
    return solidAngle(p_W);  // every ray met an edge: rare and slow, but certain
  }

 private:
  static constexpr double kAnywhere = std::numeric_limits<double>::infinity();

  /// The winding number without rays: the solid angle of the triangles around the point, in full spheres.
  /// A. van Oosterom, J. Strackee, "The Solid Angle of a Plane Triangle" (1983).
  int solidAngle(const Eigen::Vector3d& p_W) const {
    double sum = 0;
    for (const auto& t : mesh_.triangles) {
      const Eigen::Vector3d a = mesh_.vertices_W[t[0]].cast<double>() - p_W;
      const Eigen::Vector3d b = mesh_.vertices_W[t[1]].cast<double>() - p_W;
      const Eigen::Vector3d c = mesh_.vertices_W[t[2]].cast<double>() - p_W;
      const double la = a.norm(), lb = b.norm(), lc = c.norm();
      sum += std::atan2(a.dot(b.cross(c)), la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
    }
    return int(std::lround(sum / (2 * std::numbers::pi)));
  }

  /// Embree's coordinates: relative to the middle of the mesh, so that its position costs no float precision.
  Eigen::Vector3f local(const Eigen::Vector3d& p_W) const { return (p_W - middle_W_).cast<float>(); }

  void release() {
    if (scene_) rtcReleaseScene(scene_);
    if (device_) rtcReleaseDevice(device_);
  }

  /// @param within_m  search radius  @param slack_m  see Nearest
  Nearest nearest(const Eigen::Vector3d& p_W, double within_m, double slack_m,
                  std::vector<std::uint32_t>* touching) const {
    // Embree culls with a float point: its rounding error is added to the radius.
    const double rounding_m = rounding_m_ + kFloatRounding * (p_W - middle_W_).norm();
    Nearest state{&mesh_, p_W, slack_m + rounding_m, kAnywhere, p_W, 0, touching};
    RTCPointQuery query;
    const Eigen::Vector3f p = local(p_W);
    query.x = p.x();
    query.y = p.y();
    query.z = p.z();
    query.time = 0;
    query.radius = float((within_m + slack_m + rounding_m) * (1 + kFloatRounding));
    RTCPointQueryContext context;
    rtcInitPointQueryContext(&context);
    rtcPointQuery(scene_, &query, &context, nullptr, &state);
    return state;
  }

  int crossings(const Eigen::Vector3d& p_W, const Eigen::Vector3f& direction, bool& near_edge) const {
    Crossings state;
    initialize(state.context);
    state.mesh = &mesh_;
    state.p_W = p_W;
    state.direction = direction.cast<double>();
    state.edge_margin_m = 2 * rounding_m_;
    state.winding = 0;
    state.near_edge = false;
    // Starts slightly behind the point, so that rounding does not miss a surface right in front of it.
    const Eigen::Vector3f begin = local(p_W - 16 * rounding_m_ * state.direction);
    RTCRay ray;
    ray.org_x = begin.x();
    ray.org_y = begin.y();
    ray.org_z = begin.z();
    ray.dir_x = direction.x();
    ray.dir_y = direction.y();
    ray.dir_z = direction.z();
    ray.tnear = 0;
    ray.tfar = std::numeric_limits<float>::infinity();
    ray.time = 0;
    ray.mask = 0xFFFFFFFFu;
    ray.id = 0;
    ray.flags = 0;
    occluded(scene_, state.context, ray);
    near_edge = state.near_edge;
    return state.winding;
  }

  TriangleMesh mesh_;
  Eigen::AlignedBox3d box_W_;
  Eigen::Vector3d middle_W_ = {0, 0, 0};
  double rounding_m_ = 0;
  RTCDevice device_ = nullptr;
  RTCScene scene_ = nullptr;
};

}  // namespace

std::shared_ptr<const SignedDistance> makeMeshDistance(const TriangleMesh& mesh, std::string& why_not) {
  why_not = whyNotClosed(mesh);
  if (!why_not.empty()) return nullptr;
  auto distance = std::make_shared<const MeshDistance>(mesh);
  for (const std::uint32_t triangle : insideOutCandidates(mesh)) {
    // A part with negative volume is a cavity if it is inside another part; otherwise it is inside out: then a ray from
    // just outside its surface counts below zero.
    const auto& t = mesh.triangles[triangle];
    const Eigen::Vector3d centre_W =
        (mesh.vertices_W[t[0]] + mesh.vertices_W[t[1]] + mesh.vertices_W[t[2]]).cast<double>() / 3;
    const double step_m = 1e-3 * std::sqrt(triangleArea(mesh, triangle));
    if (distance->winding(centre_W + step_m * triangleNormal(mesh, triangle)) < 0) {
      why_not = "a part of the mesh is turned inside out: its triangles face inwards";
      return nullptr;
    }
  }
  return distance;
}

}  // namespace accessvdb::sim
