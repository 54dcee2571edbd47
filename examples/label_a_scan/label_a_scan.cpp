// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// label_a_scan: which surfaces of one scan can a tool reach?
///   label_a_scan                              a generated scan of a walk past trees
///   label_a_scan SCAN X Y Z QX QY QZ QW       a .pcd, .ply, .bin or .las scan in the sensor frame, and its pose
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/error.h"
#include "accessvdb/scan_io.h"
#include "sample_scans/walk_generator.h"

namespace {

struct Scan {
  std::vector<Eigen::Vector3f> points_S;
  Eigen::Isometry3d T_W_S;
};

Scan generatedScan() {
  const accessvdb::samples::WalkFrame frame = accessvdb::samples::WalkGenerator({.frames = 1}).frame(0);
  return {frame.points_S, frame.T_W_S};
}

double number(const std::string& text) {
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  if (end != text.c_str() && *end == '\0' && std::isfinite(value)) return value;
  throw accessvdb::InvalidArgument("example.number", text, "is not a finite number", "Use X Y Z QX QY QZ QW");
}

/// @param pose  x y z qx qy qz qw, sensor to world
Scan scanFromFile(const std::string& path, const std::vector<std::string>& pose) {
  std::vector<double> p;
  for (const std::string& text : pose) p.push_back(number(text));
  Eigen::Quaterniond q(p[6], p[3], p[4], p[5]);
  if (!(q.norm() > 0.5)) throw accessvdb::UnusableInput("example.pose", "", "the quaternion is almost zero");
  Scan scan;
  scan.T_W_S = Eigen::Translation3d(p[0], p[1], p[2]) * q.normalized();
  // A cloud "seen from the origin" is read unchanged, in its file's frame: here the sensor's.
  auto file = accessvdb::io::ScanSequence::open({.scans = path, .sensor_at_W = Eigen::Vector3d(0, 0, 0)});
  for (std::size_t step = 0; step < file.size(); ++step) {
    for (const Eigen::Vector3d& point : file.read(step).points_W) scan.points_S.push_back(point.cast<float>());
  }
  return scan;
}

void run(const std::vector<std::string>& arguments) {
  if (!arguments.empty() && arguments.size() != 8) {
    throw accessvdb::InvalidArgument("example.arguments", "", "pass nothing, or SCAN X Y Z QX QY QZ QW");
  }
  const Scan scan =
      arguments.empty() ? generatedScan() : scanFromFile(arguments[0], {arguments.begin() + 1, arguments.end()});

  const auto tool = accessvdb::ToolGeometry::builtin("builtin:pencil");
  accessvdb::AccessibilityField field(tool, {.tsdf = {.voxel_size_m = 0.05}});
  const accessvdb::FrameStats stats = field.integrateScan(scan.points_S, scan.T_W_S);
  field.update();

  const accessvdb::FieldSnapshot snapshot = field.snapshot();
  std::printf("returns used %llu of %llu\nsurface points %zu\n", static_cast<unsigned long long>(stats.points_used),
              static_cast<unsigned long long>(stats.points_in), snapshot.points.size());
  for (const auto label :
       {accessvdb::PointLabel::Accessible, accessvdb::PointLabel::Blocked, accessvdb::PointLabel::Unscored}) {
    std::printf("%s %llu\n", accessvdb::name(label), static_cast<unsigned long long>(snapshot.count(label)));
  }
  for (const accessvdb::SurfacePoint& point : snapshot.accessible()) {  // the first one, as an example
    std::printf("for example %.2f %.2f %.2f, tool pointing out at yaw %.0f degrees\n", point.position_W.x(),
                point.position_W.y(), point.position_W.z(), point.yaw_rad * 180 / M_PI);
    break;
  }
}

}  // namespace

int main(int argc, char** argv) {
  try {
    run({argv + 1, argv + argc});
    return 0;
  } catch (const accessvdb::Error& error) {
    std::fprintf(stderr, "label_a_scan: %s\n", error.what());
    return error.exitCode();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "label_a_scan: %s\n", error.what());
    return static_cast<int>(accessvdb::ErrorCode::Internal);
  }
}
