// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "sim/ray_caster.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/error.h"
#include "sim/embree.h"

namespace accessvdb::sim {
namespace {

constexpr float kNoHit = std::numeric_limits<float>::infinity();
constexpr std::size_t kRaysPerCall = 256;  // their records stay in the cache
/// Embree's own range is good to about a millionth; a plane that disagrees is met edge-on.
constexpr double kPlaneAgreement = 1e-4;

/// Throws Embree's last error as one of ours. @param device  null: it could not start
void requireNoError(RTCDevice device, const char* doing) {
  const RTCError error = rtcGetDeviceError(device);
  if (error == RTC_ERROR_NONE) return;
  if (error == RTC_ERROR_OUT_OF_MEMORY) {
    throw ResourceLimit("sim.memory", "", std::string("Embree ran out of memory while ") + doing,
                        "Use a coarser mesh or free some memory");
  }
  throw InternalError("sim.embree", "",
                      std::string("Embree failed while ") + doing + " (code " + std::to_string(error) + ")");
}

}  // namespace

struct RayCaster::Impl {
  /// Rz(yaw) and the translation, in double precision.
  struct Place {
    std::uint32_t mesh;
    Eigen::Matrix3d R_W_M;
    Eigen::Vector3d offset_W;
  };

  RTCDevice device = nullptr;
  RTCScene scene = nullptr;
  std::vector<TriangleMesh> meshes;
  std::vector<RTCScene> mesh_scenes;  ///< one per mesh, if placed
  std::vector<Place> places;          ///< by Embree's instance id; empty if the only mesh is not moved

  ~Impl() {
    if (scene) rtcReleaseScene(scene);
    for (RTCScene each : mesh_scenes) rtcReleaseScene(each);
    if (device) rtcReleaseDevice(device);
  }

  /// The range along the exact line to the plane of the triangle that Embree found, in double precision: independent of
  /// Embree's instruction set and of the rounding of the origin to float.
  [[nodiscard]] double planeRange_m(const Eigen::Vector3d& origin_W, const Eigen::Vector3f& direction_W,
                                    const RTCRayHit& found) const {
    const double coarse_m = static_cast<double>(found.ray.tfar);
    Eigen::Vector3d origin = origin_W, direction = direction_W.cast<double>();
    const TriangleMesh* mesh = &meshes.front();
    if (!places.empty()) {
      const Place& place = places[found.hit.instID[0]];
      mesh = &meshes[place.mesh];
      origin = place.R_W_M.transpose() * (origin_W - place.offset_W);
      direction = place.R_W_M.transpose() * direction;
    }
    const auto& triangle = mesh->triangles[found.hit.primID];
    const Eigen::Vector3d a = mesh->vertices_W[triangle[0]].cast<double>();
    const Eigen::Vector3d b = mesh->vertices_W[triangle[1]].cast<double>();
    const Eigen::Vector3d c = mesh->vertices_W[triangle[2]].cast<double>();
    const Eigen::Vector3d normal = (b - a).cross(c - a);
    const double range_m = normal.dot(a - origin) / normal.dot(direction);
    const bool agrees = range_m > 0 && std::abs(range_m - coarse_m) <= kPlaneAgreement * (1 + coarse_m);
    return agrees ? range_m : coarse_m;
  }

  void start() {
    device = rtcNewDevice(nullptr);
    if (device) return;
    requireNoError(nullptr, "starting");
    throw InternalError("sim.embree", "", "Embree could not be started");
  }

  [[nodiscard]] RTCScene newScene() const {
    RTCScene made = rtcNewScene(device);
    // Robust: no ray slips through an edge, and the nearest hit does not depend on how the tree was built.
    rtcSetSceneFlags(made, RTC_SCENE_FLAG_ROBUST);
    return made;
  }

  void attach(RTCScene to, const TriangleMesh& mesh) const {
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    // Copies into Embree's buffers, which need padding that std::vector does not guarantee.
    void* vertices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                             sizeof(Eigen::Vector3f), mesh.vertices_W.size());
    void* triangles = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                              sizeof(mesh.triangles[0]), mesh.triangles.size());
    if (!vertices || !triangles) {
      rtcReleaseGeometry(geometry);
      requireNoError(device, "taking the mesh");
      throw InternalError("sim.embree", "", "Embree did not accept the mesh");
    }
    static_assert(sizeof(Eigen::Vector3f) == 12 && sizeof(mesh.triangles[0]) == 12);
    std::copy(mesh.vertices_W.begin(), mesh.vertices_W.end(), static_cast<Eigen::Vector3f*>(vertices));
    std::copy(mesh.triangles.begin(), mesh.triangles.end(), static_cast<std::array<std::uint32_t, 3>*>(triangles));
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(to, geometry);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(to);
    requireNoError(device, "building its tree");
  }

  void place(const PlacedMesh& placed) {
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_INSTANCE);
    rtcSetGeometryInstancedScene(geometry, mesh_scenes[placed.mesh]);
    const Eigen::Matrix3d R = Eigen::AngleAxisd(placed.yaw_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    Eigen::Matrix<float, 3, 4> to_W;  // column by column, as Embree requires
    to_W << R.cast<float>(), placed.offset_W.cast<float>();
    rtcSetGeometryTransform(geometry, 0, RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, to_W.data());
    rtcCommitGeometry(geometry);
    rtcAttachGeometryByID(scene, geometry, static_cast<unsigned>(places.size()));
    rtcReleaseGeometry(geometry);
    places.push_back({placed.mesh, R, placed.offset_W});
  }
};

namespace {

void requireTriangles(const TriangleMesh& mesh) {
  if (mesh.triangles.empty()) {
    throw InvalidArgument("sim.no_triangles", "scene", "the mesh has no triangles", "Use a scene with a surface");
  }
  for (const auto& triangle : mesh.triangles) {
    if (*std::max_element(triangle.begin(), triangle.end()) >= mesh.vertices_W.size()) {
      throw InvalidArgument("sim.index", "scene", "a triangle refers to a vertex that does not exist");
    }
  }
}

}  // namespace

RayCaster::RayCaster(const TriangleMesh& mesh) : impl_(std::make_unique<Impl>()) {
  requireTriangles(mesh);
  impl_->meshes = {mesh};
  impl_->start();
  impl_->scene = impl_->newScene();
  impl_->attach(impl_->scene, mesh);
}

RayCaster::RayCaster(std::vector<TriangleMesh> meshes, std::span<const PlacedMesh> placed)
    : impl_(std::make_unique<Impl>()) {
  for (const TriangleMesh& mesh : meshes) requireTriangles(mesh);
  if (placed.empty()) {
    throw InvalidArgument("sim.nothing_placed", "scene", "no mesh is placed", "Place at least one");
  }
  for (const PlacedMesh& each : placed) {
    if (each.mesh < meshes.size() && each.offset_W.allFinite() && std::isfinite(each.yaw_rad)) continue;
    throw InvalidArgument("sim.placed", "scene", "a placed mesh does not exist, or its position is not finite");
  }
  impl_->meshes = std::move(meshes);
  impl_->start();
  for (const TriangleMesh& mesh : impl_->meshes) {
    impl_->mesh_scenes.push_back(impl_->newScene());
    impl_->attach(impl_->mesh_scenes.back(), mesh);
  }
  impl_->scene = impl_->newScene();
  for (const PlacedMesh& each : placed) impl_->place(each);
  rtcCommitScene(impl_->scene);
  requireNoError(impl_->device, "building its tree of places");
}

RayCaster::~RayCaster() = default;
RayCaster::RayCaster(RayCaster&&) noexcept = default;
RayCaster& RayCaster::operator=(RayCaster&&) noexcept = default;

void RayCaster::cast(const Eigen::Vector3d& origin_W, std::span<const Eigen::Vector3f> directions_W,
                     std::span<float> ranges_m) const {
  if (ranges_m.size() != directions_W.size()) {
    throw InvalidArgument("sim.cast", "ranges_m", "its size is not the number of directions");
  }
  const Eigen::Vector3f origin = origin_W.cast<float>();
  std::vector<RTCRayHit> rays(std::min(kRaysPerCall, directions_W.size()));
  for (std::size_t begin = 0; begin < directions_W.size(); begin += kRaysPerCall) {
    const std::size_t count = std::min(kRaysPerCall, directions_W.size() - begin);
    for (std::size_t i = 0; i < count; ++i) {
      const Eigen::Vector3f& direction = directions_W[begin + i];
      RTCRayHit& ray = rays[i];
      ray.ray = {origin.x(), origin.y(), origin.z(), 0, direction.x(), direction.y(), direction.z(), 0,
                 kNoHit,     ~0u,        0,          0};
      ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
      ray.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    }
    RayContext context;
    initialize(context);
    intersect(impl_->scene, context, rays.data(), static_cast<unsigned>(count));
    for (std::size_t i = 0; i < count; ++i) {
      const bool hit = rays[i].hit.geomID != RTC_INVALID_GEOMETRY_ID;
      ranges_m[begin + i] =
          hit ? static_cast<float>(impl_->planeRange_m(origin_W, directions_W[begin + i], rays[i])) : kNoHit;
    }
  }
}

}  // namespace accessvdb::sim
