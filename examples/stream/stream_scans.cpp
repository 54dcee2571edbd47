// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// stream_scans [FRAMES]: the loop of a robot. In each frame, it integrates the scan, updates the labels, lists what
/// became reachable, and checks whether the arm's path to the nearest new point is free.
#include <charconv>
#include <cstdio>
#include <cstring>
#include <utility>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/batch_query.h"
#include "accessvdb/error.h"
#include "sample_scans/walk_generator.h"

namespace {

using accessvdb::PointLabel;
using accessvdb::SurfacePoint;

const char* wordFor(const accessvdb::CapsuleAnswer& way) {
  if (way.free()) return "free";
  return way.collision ? "blocked" : "not all seen";
}

void run(int frames) {
  const accessvdb::samples::WalkGenerator walk({.frames = frames, .rays_per_frame = 8000, .max_range_m = 10});
  const auto tool = accessvdb::ToolGeometry::builtin("builtin:pencil");
  accessvdb::AccessibilityField field(tool, {.tsdf = {.voxel_size_m = 0.05}});

  std::vector<PointLabel> labels;  // of the previous frame, by id: ids are stable
  for (int n = 0; n < frames; ++n) {
    const accessvdb::samples::WalkFrame frame = walk.frame(n);  // from the driver and the odometry, on a robot
    const accessvdb::FrameStats in = field.integrateScan(frame.points_S, frame.T_W_S);
    const accessvdb::UpdateStats update = field.update();

    const Eigen::Vector3d sensor_W = frame.T_W_S.translation();
    const accessvdb::FieldSnapshot snapshot = field.snapshot();
    labels.resize(snapshot.points.size(), PointLabel::Unscored);
    const SurfacePoint* nearest = nullptr;
    std::size_t reachable = 0, fresh = 0, lost = 0;
    for (const SurfacePoint& point : snapshot.points) {
      const PointLabel before = std::exchange(labels[point.id], point.label);
      lost += before == PointLabel::Accessible && point.label != PointLabel::Accessible;
      if (point.label != PointLabel::Accessible) continue;
      ++reachable;
      fresh += before != PointLabel::Accessible;
      if (nearest == nullptr || (point.position_W - sensor_W).norm() < (nearest->position_W - sensor_W).norm()) {
        nearest = &point;
      }
    }
    std::printf("frame %d: %zu reachable, %zu new, %zu lost; integrate %.1f ms, update %.1f ms", n, reachable, fresh,
                lost, in.integrate_ms + in.mirror_ms, update.update_ms + update.score_ms);
    if (nearest != nullptr) {
      // From 0.25 m in front of the point to 0.1 m in front of it, with a gripper of 6 cm.
      const Eigen::Vector3d out = nearest->direction_W.cast<double>();
      const accessvdb::CapsuleQuery way{nearest->position_W + 0.25 * out, nearest->position_W + 0.1 * out, 0.03};
      std::printf("; way to the nearest: %s", wordFor(field.batchQuery().along({&way, 1})[0]));
    }
    std::printf("\n");
  }
}

}  // namespace

int main(int argc, char** argv) {
  try {
    int frames = 8;
    if (argc > 1) {
      const auto [end, error] = std::from_chars(argv[1], argv[1] + std::strlen(argv[1]), frames);
      if (error != std::errc() || *end != '\0' || frames < 1) {
        throw accessvdb::InvalidArgument("example.frames", argv[1], "is not a number of frames", "Use 1 or more");
      }
    }
    run(frames);
    return 0;
  } catch (const accessvdb::Error& error) {
    std::fprintf(stderr, "stream_scans: %s\n", error.what());
    return error.exitCode();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "stream_scans: %s\n", error.what());
    return static_cast<int>(accessvdb::ErrorCode::Internal);
  }
}
