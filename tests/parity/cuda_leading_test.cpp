// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// A field whose scans the device fuses first: whatever is asked in between, and from whichever scan on the host fuses
// first again, points and map are those of a field on the CPU.
#include <gtest/gtest.h>

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "accessvdb/error.h"
#include "accessvdb/region.h"
#include "accessvdb/what_if.h"
#include "parity/gpu_test.h"
#include "parity/parity_walk.h"
#include "parity/view_reads.h"
#include "support/determinism_support.h"
#include "support/same_map.h"

namespace accessvdb::test {
namespace {

constexpr int kFrames = 10;

FieldParams paramsAt(double voxel_size_m, BackendKind backend) {
  FieldParams params;
  params.tsdf.voxel_size_m = voxel_size_m;
  params.tsdf.range_noise_m = 0.02;
  params.backend = backend;
  return params;
}

const std::vector<WalkFrame>& walkFrames() {
  static const std::vector<WalkFrame> frames = [] {
    WalkOptions options = parityWalk(71, kFrames, 4000);
    options.max_range_m = 8;
    return allFrames(options);
  }();
  return frames;
}

const ToolGeometry& pencil() {
  static const ToolGeometry tool = ToolGeometry::builtin("builtin:pencil");
  return tool;
}

/// Two fields, one on each processor.
class BothFields {
 public:
  explicit BothFields(double voxel_size_m, std::uint64_t cache_bytes = 0)
      : cpu_(pencil(), paramsAt(voxel_size_m, BackendKind::Cpu)), gpu_(pencil(), [&] {
          FieldParams params = paramsAt(voxel_size_m, BackendKind::Cuda);
          params.device_cache_bytes = cache_bytes;
          return params;
        }()) {}

  /// @return whether the device fused
  bool integrate(int frame) {
    const WalkFrame& scan = walkFrames()[static_cast<std::size_t>(frame)];
    const FrameStats cpu = cpu_.integrateScan(scan.points_S, scan.T_W_S);
    const FrameStats gpu = gpu_.integrateScan(scan.points_S, scan.T_W_S);
    EXPECT_EQ(gpu.touched_leaves, cpu.touched_leaves);
    EXPECT_EQ(gpu.new_leaves, cpu.new_leaves);
    EXPECT_EQ(gpu.changed_leaves, cpu.changed_leaves);
    EXPECT_EQ(gpu.distance_updates, cpu.distance_updates);
    EXPECT_EQ(gpu.cleared_updates, cpu.cleared_updates);
    EXPECT_EQ(gpu.flipped_voxels, cpu.flipped_voxels);
    EXPECT_GT(gpu.changed_leaves, 0u);
    EXPECT_FALSE(cpu.fused_on_device);
    EXPECT_EQ(gpu.fused_on_device, gpu.mirror_bytes == 0);  // else the host sent what flipped
    return gpu.fused_on_device;
  }
  void both(const std::function<void(AccessibilityField&)>& act) {
    act(cpu_);
    act(gpu_);
  }
  void update() {
    both([](AccessibilityField& field) { field.update(); });
  }
  void expectSameFields() const {
    expectSame(cpu_.snapshot(), gpu_.snapshot());
    expectSameMap(cpu_.volume(), gpu_.volume());
  }
  [[nodiscard]] AccessibilityField& gpu() { return gpu_; }
  [[nodiscard]] AccessibilityField& cpu() { return cpu_; }

 private:
  AccessibilityField cpu_, gpu_;
};

class CudaLeading : public GpuTest {};

TEST_F(CudaLeading, IsOnByDefaultAndOffByRequest) {
  BothFields fields(0.05);
  EXPECT_TRUE(fields.integrate(0));
  FieldParams params = paramsAt(0.05, BackendKind::Cuda);
  params.fuse_on_host = true;
  AccessibilityField host(pencil(), params);
  const FrameStats stats = host.integrateScan(walkFrames()[0].points_S, walkFrames()[0].T_W_S);
  EXPECT_GT(stats.mirror_bytes, 0u);
}

/// The host's map is behind whenever nobody asks.
TEST_F(CudaLeading, AnswersAsIfTheHostWereNotBehind) {
  BothFields fields(0.03);
  for (int frame = 0; frame < kFrames; ++frame) {
    SCOPED_TRACE(frame);
    EXPECT_TRUE(fields.integrate(frame));
    if (frame % 3 != 1) fields.update();  // one or two scans an update
    if (frame % 4 == 3) {
      fields.update();
      fields.expectSameFields();
    }
    if (HasFailure()) return;
  }
  fields.update();
  fields.expectSameFields();
  expectSame(fields.cpu().evaluateFromScratch(), fields.gpu().evaluateFromScratch());
}

TEST_F(CudaLeading, UpdatesRunBesideScans) {
  BothFields fields(0.03);
  UpdateTicket ticket;
  for (int frame = 0; frame < kFrames; ++frame) {
    EXPECT_TRUE(fields.integrate(frame));
    fields.cpu().update();
    ticket = fields.gpu().updateAsync();
    if (HasFailure()) return;
  }
  static_cast<void>(ticket.wait());
  fields.expectSameFields();
}

/// What the device holds no more comes back from the host: values that are fused into, and weights.
TEST_F(CudaLeading, ASmallCacheChangesNothing) {
  BothFields fields(0.015, 64'000'000);
  for (int turn = 0; turn < 2; ++turn) {
    for (int frame = 0; frame < kFrames; ++frame) {
      EXPECT_TRUE(fields.integrate(turn == 0 ? frame : kFrames - 1 - frame));
      if (HasFailure()) return;
    }
    fields.update();
    fields.expectSameFields();
  }
}

/// What does not depend on when a point was evaluated: the reason of a blocked point does, and stability.
void expectSameLabels(const FieldSnapshot& a, const FieldSnapshot& b) {
  ASSERT_EQ(a.points.size(), b.points.size());
  for (std::size_t n = 0; n < a.points.size(); ++n) {
    const SurfacePoint &in_a = a.points[n], &in_b = b.points[n];
    ASSERT_EQ(in_a.position_W, in_b.position_W) << n;
    ASSERT_EQ(in_a.normal_W, in_b.normal_W) << n;
    ASSERT_EQ(in_a.weight, in_b.weight) << n;
    ASSERT_EQ(in_a.label, in_b.label) << n << ": " << text(in_a) << "; " << text(in_b);
    if (in_a.label != PointLabel::Accessible) continue;
    ASSERT_EQ(in_a.score, in_b.score) << n;
    ASSERT_EQ(in_a.direction, in_b.direction) << n;
  }
}

/// Mixes up values around points on the device, around one point of so many. @return of how many leaves
std::uint32_t breakMemory(const AccessibilityField& field, std::uint32_t one_of) {
  const auto backend = kernels::makeCudaBackend();  // only for memory
  std::vector<ViewQuestion> positions;
  for (const SurfacePoint& point : field.snapshot().points) {
    if (point.id % one_of != 0) continue;
    ViewQuestion& position = positions.emplace_back();
    for (int axis = 0; axis < 3; ++axis) position.a_W[axis] = point.position_W[axis];
  }
  return swapValuesOnDevice(*backend, field.deviceView(), positions);
}

/// Leaves that a scan reaches again have wrong values on the device. Labels are right from the first answer on that
/// somebody gets, at the latest once the host is there.
TEST_F(CudaLeading, AMapThatDiffersIsMadeAgain) {
  for (const bool updated : {false, true}) {
    SCOPED_TRACE(updated ? "with labels" : "without");
    BothFields fields(0.03);
    int frame = 0;
    for (; frame < 3; ++frame) EXPECT_TRUE(fields.integrate(frame));
    if (updated) fields.update();
    for (int time = 1; time <= 2; ++time) {
      EXPECT_TRUE(fields.integrate(frame++));  // values come to the device as scans reach them
      EXPECT_GT(breakMemory(fields.gpu(), 3), 50u);
      const WalkFrame& scan = walkFrames()[static_cast<std::size_t>(frame++)];
      fields.both([&](AccessibilityField& field) { field.integrateScan(scan.points_S, scan.T_W_S); });
      if (updated) fields.update();
      const FieldSnapshot cpu = fields.cpu().snapshot(), gpu = fields.gpu().snapshot();
      EXPECT_EQ(fields.gpu().deviceNoteId(), "device.diverged");
      EXPECT_NE(fields.gpu().deviceNote().find(std::to_string(time) + " times"), std::string::npos);
      expectSameLabels(cpu, gpu);
      expectSameMap(fields.cpu().volume(), fields.gpu().volume());
      if (updated) expectVaried(gpu);
      if (HasFailure()) return;
    }
    for (; frame < kFrames; ++frame) {
      EXPECT_TRUE(fields.integrate(frame)) << "the device leads again";
      fields.update();
      expectSameLabels(fields.cpu().snapshot(), fields.gpu().snapshot());
      if (HasFailure()) return;
    }
  }
}

/// A device on which that happens again and again ends the run, as any failure of a device.
TEST_F(CudaLeading, AMapThatDiffersAgainAndAgainEndsTheRun) {
  AccessibilityField field(pencil(), paramsAt(0.03, BackendKind::Cuda));
  const auto integrate = [&](int frame) {
    const WalkFrame& scan = walkFrames()[static_cast<std::size_t>(frame)];
    field.integrateScan(scan.points_S, scan.T_W_S);
  };
  std::string id;
  int times = 0;
  for (int frame = 0; frame + 1 < kFrames && id.empty(); frame += 2, ++times) {
    integrate(frame);
    EXPECT_GT(breakMemory(field, 1), 50u);
    try {
      integrate(frame + 1);
      static_cast<void>(field.snapshot());
    } catch (const DeviceError& error) {
      id = error.id();
    }
  }
  EXPECT_EQ(id, "device.diverged");
  EXPECT_EQ(times, 4) << "it is made again three times";
  EXPECT_EQ(field.unscoredSnapshot().count(PointLabel::Accessible), 0u);
}

/// From there on the host fuses first, or the device begins with what the map is then. Flips of the scans before, and
/// of that one, wait for an update.
TEST_F(CudaLeading, EndsOrBeginsAgainWhereOthersChangeTheMap) {
  struct Event {
    const char* name;
    std::function<void(AccessibilityField&)> act;
    bool ends;
  };
  const Region bar = Region::box({-2.5, 2.2, 0.2}, {0.5, 3.2, 1.8});
  const Event events[] = {
      {"stopGrowing", [](AccessibilityField& field) { field.stopGrowing(); }, true},
      {"removeRegion", [&](AccessibilityField& field) { field.removeRegion(bar); }, false},
      {"removeRegion as free", [&](AccessibilityField& field) { field.removeRegion(bar, RemovedAs::Free); }, false},
      {"whatIf", [&](AccessibilityField& field) { static_cast<void>(field.whatIf(std::span(&bar, 1))); }, false}};
  for (const Event& event : events) {
    for (const bool updated : {false, true}) {
      SCOPED_TRACE(std::string(event.name) + (updated ? ", after an update" : ""));
      BothFields fields(0.05);
      for (int frame = 0; frame < 4; ++frame) {
        EXPECT_TRUE(fields.integrate(frame));
        if (frame == 1) fields.update();
      }
      if (updated || !event.ends) fields.update();
      fields.both(event.act);
      for (int frame = 4; frame < 8; ++frame) {
        const bool led = fields.integrate(frame);
        if (event.ends) {
          EXPECT_FALSE(led);
        } else {
          EXPECT_TRUE(led);
        }
        if (frame % 2 == 1) fields.update();
      }
      fields.expectSameFields();
      if (HasFailure()) return;
    }
  }
}

/// A device knows nothing of voxels that were left out: with such a map the host goes on.
TEST_F(CudaLeading, ASavedFieldThatLeftVoxelsOutGoesOnOnTheHost) {
  const std::filesystem::path file = std::filesystem::path(testing::TempDir()) / "left_out.state";
  BothFields fields(0.05);
  for (int frame = 0; frame < 3; ++frame) EXPECT_TRUE(fields.integrate(frame));
  fields.update();
  fields.both([](AccessibilityField& field) { field.stopGrowing(); });
  for (int frame = 7; frame < kFrames; ++frame) EXPECT_FALSE(fields.integrate(frame));
  fields.update();
  const auto loadedOn = [&](AccessibilityField& field, BackendKind backend) {
    field.saveState(file);
    AccessibilityField loaded = AccessibilityField::loadState(file, pencil(), backend);
    std::filesystem::remove(file);
    return loaded;
  };
  AccessibilityField cpu = loadedOn(fields.cpu(), BackendKind::Cpu), gpu = loadedOn(fields.gpu(), BackendKind::Cuda);
  for (int frame = 5; frame < kFrames; ++frame) {
    const WalkFrame& scan = walkFrames()[static_cast<std::size_t>(frame)];
    cpu.integrateScan(scan.points_S, scan.T_W_S);
    EXPECT_GT(gpu.integrateScan(scan.points_S, scan.T_W_S).mirror_bytes, 0u);
    if (frame % 2 == 1) continue;
    cpu.update();
    gpu.update();
  }
  cpu.update();
  gpu.update();
  // Only the CPU goes on from what was known of blocked points, whose reasons depend on that.
  const FieldSnapshot on_cpu = cpu.snapshot(), on_gpu = gpu.snapshot();
  ASSERT_EQ(on_cpu.points.size(), on_gpu.points.size());
  for (std::size_t n = 0; n < on_cpu.points.size(); ++n) {
    ASSERT_EQ(on_cpu.points[n].label, on_gpu.points[n].label) << n;
  }
  expectSame(cpu.evaluateFromScratch(), gpu.evaluateFromScratch());
  expectSameMap(cpu.volume(), gpu.volume());
}

TEST_F(CudaLeading, ASavedFieldGoesOn) {
  const std::filesystem::path file = std::filesystem::path(testing::TempDir()) / "led.state";
  BothFields fields(0.05);
  for (int frame = 0; frame < 4; ++frame) EXPECT_TRUE(fields.integrate(frame));
  fields.update();
  fields.gpu().saveState(file);
  AccessibilityField loaded = AccessibilityField::loadState(file, pencil(), BackendKind::Cuda);
  std::filesystem::remove(file);
  for (int frame = 4; frame < 7; ++frame) {
    const WalkFrame& scan = walkFrames()[static_cast<std::size_t>(frame)];
    const FrameStats stats = loaded.integrateScan(scan.points_S, scan.T_W_S);
    EXPECT_EQ(stats.mirror_bytes, 0u);
    EXPECT_GT(stats.changed_leaves, 0u);
    EXPECT_TRUE(fields.integrate(frame));
  }
  fields.update();
  loaded.update();
  expectSame(fields.cpu().snapshot(), loaded.snapshot());
  expectSameMap(fields.cpu().volume(), loaded.volume());
  fields.expectSameFields();
}

}  // namespace
}  // namespace accessvdb::test
