// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// own_kernel: the live field inside a kernel of your own, without a copy. For every accessible point, the kernel
/// checks whether an 8 cm wrist behind the tool, which the tool's mesh does not include, still has room. Needs a GPU.
#include <cstdio>
#include <stdexcept>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/error.h"
#include "own_kernel/wrist_check.h"
#include "sample_scans/walk_generator.h"

namespace {

void run() {
  accessvdb::FieldParams params;
  params.tsdf.voxel_size_m = 0.05;
  params.backend = accessvdb::BackendKind::Cuda;
  accessvdb::AccessibilityField field(accessvdb::ToolGeometry::builtin("builtin:pencil"), params);
  params.backend = accessvdb::BackendKind::Cpu;  // the same on the host, for comparison
  accessvdb::AccessibilityField on_host(accessvdb::ToolGeometry::builtin("builtin:pencil"), params);

  const accessvdb::samples::WalkGenerator walk({.frames = 5, .rays_per_frame = 8000, .max_range_m = 8});
  for (int n = 0; n < walk.frames(); ++n) {
    const accessvdb::samples::WalkFrame frame = walk.frame(n);
    for (auto* f : {&field, &on_host}) {
      f->integrateScan(frame.points_S, frame.T_W_S);
      f->update();
    }
    const accessvdb::DeviceView view = field.deviceView();  // again after each change
    const accessvdb::DeviceView host = on_host.hostView();
    const std::vector<unsigned char> verdicts = judgeOnGpu(view);
    unsigned long long counts[kNumVerdicts] = {}, different = 0;
    for (std::uint32_t id = 0; id < view.points.count; ++id) {
      ++counts[verdicts[id]];
      different += verdicts[id] != judge(host, id);
    }
    std::printf(
        "frame %d on %s: %u points, wrist free %llu, collides %llu, not seen %llu; different on the host %llu\n", n,
        field.deviceName().c_str(), view.points.count, counts[kFree], counts[kCollides], counts[kNotSeen], different);
    if (different != 0 || view.points.count != host.points.count) {
      throw std::runtime_error("the kernel and the host disagree");
    }
  }
}

}  // namespace

int main() {
  try {
    run();
    return 0;
  } catch (const accessvdb::Error& error) {  // no GPU: code 6
    std::fprintf(stderr, "own_kernel: %s\n", error.what());
    return error.exitCode();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "own_kernel: %s\n", error.what());
    return static_cast<int>(accessvdb::ErrorCode::Internal);
  }
}
