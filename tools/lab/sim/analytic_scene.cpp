// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <cstdio>
#include <utility>

#include "accessvdb/error.h"
#include "sim/analytic_distance.h"
#include "sim/scene.h"
#include "sim/tessellation.h"

namespace accessvdb::sim {
namespace {

/// Two thousandths of the finest voxel of the tables (1 mm): its effect on a range is far below the map's float noise,
/// and the meshes stay below a million triangles.
constexpr double kTessellationError_m = 2e-6;
constexpr double kSmallest_m = 1e-4, kLargest_m = 1000.0;

template <typename... Values>
std::string formatted(const char* format, Values... values) {
  char text[256];
  std::snprintf(text, sizeof text, format, values...);
  return text;
}

/// @throws InvalidArgument unless the length is sensible for a scene
void requireLength(double length_m, const char* what) {
  if (length_m >= kSmallest_m && length_m <= kLargest_m) return;
  throw InvalidArgument("scene.size", what,
                        formatted("%g m is outside %g m .. %g m", length_m, kSmallest_m, kLargest_m),
                        "Use a length in metres");
}

Scene assemble(std::string name, std::string description, Tessellation surface,
               std::shared_ptr<const SignedDistance> distance) {
  Scene scene;
  scene.name = std::move(name);
  scene.description = std::move(description);
  scene.mesh = std::move(surface.mesh);
  scene.tessellation_error_m = surface.error_m;
  scene.distance = std::move(distance);
  scene.distance_note = "closed form of the exact shape";
  return scene;
}

class TranslatedDistance final : public SignedDistance {
 public:
  TranslatedDistance(std::shared_ptr<const SignedDistance> inner, const Eigen::Vector3d& offset_W)
      : inner_(std::move(inner)), offset_W_(offset_W) {}
  [[nodiscard]] double at(const Eigen::Vector3d& p_W) const override { return inner_->at(p_W - offset_W_); }
  [[nodiscard]] Eigen::Vector3d outwardNormal(const Eigen::Vector3d& p_W) const override {
    return inner_->outwardNormal(p_W - offset_W_);
  }
  [[nodiscard]] double errorBound_m() const override { return inner_->errorBound_m(); }

 private:
  std::shared_ptr<const SignedDistance> inner_;
  Eigen::Vector3d offset_W_;
};

}  // namespace

Scene makeTorus(double major_radius_m, double minor_radius_m) {
  requireLength(major_radius_m, "torus major radius");
  requireLength(minor_radius_m, "torus minor radius");
  if (!(minor_radius_m < major_radius_m)) {
    throw InvalidArgument("scene.torus", "torus",
                          formatted("minor radius %g m is not below major radius %g m", minor_radius_m, major_radius_m),
                          "Choose a thinner tube");
  }
  return assemble("torus",
                  formatted("torus, vertical axis, major radius %g m, minor radius %g m, centred at the origin",
                            major_radius_m, minor_radius_m),
                  tessellateTorus(major_radius_m, minor_radius_m, kTessellationError_m),
                  std::make_shared<TorusDistance>(Eigen::Vector3d::Zero(), major_radius_m, minor_radius_m));
}

Scene makeSphere(double radius_m) {
  requireLength(radius_m, "sphere radius");
  return assemble("sphere", formatted("sphere, radius %g m, centred at the origin", radius_m),
                  tessellateSphere(radius_m, kTessellationError_m),
                  std::make_shared<SphereDistance>(Eigen::Vector3d::Zero(), radius_m));
}

Scene makeBox(const Eigen::Vector3d& size_m, const std::string& name) {
  for (const double side_m : {size_m.x(), size_m.y(), size_m.z()}) requireLength(side_m, "box side");
  return assemble(
      name, formatted("box, axis-parallel, %g x %g x %g m, centred at the origin", size_m.x(), size_m.y(), size_m.z()),
      tessellateBox(size_m), std::make_shared<BoxDistance>(Eigen::Vector3d::Zero(), size_m));
}

Scene translated(Scene scene, const Eigen::Vector3d& offset_W) {
  if (!offset_W.allFinite() || offset_W.norm() > kLargest_m) {
    throw InvalidArgument("scene.offset", scene.name, "the offset is not within a kilometre", "Use metres");
  }
  double size_m = 0;
  for (Eigen::Vector3f& vertex_W : scene.mesh.vertices_W) {
    vertex_W = (vertex_W.cast<double>() + offset_W).cast<float>();
    size_m = std::max(size_m, static_cast<double>(vertex_W.cwiseAbs().maxCoeff()));
  }
  scene.tessellation_error_m += std::sqrt(3.0) * 0.5 * 0x1p-23 * size_m;  // rounded to float again
  if (scene.distance) scene.distance = std::make_shared<TranslatedDistance>(scene.distance, offset_W);
  scene.centre_W += offset_W;
  scene.description += formatted(", moved by (%.9g, %.9g, %.9g) m", offset_W.x(), offset_W.y(), offset_W.z());
  return scene;
}

}  // namespace accessvdb::sim
