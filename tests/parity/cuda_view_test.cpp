// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// The view of a field on the GPU, read in a kernel, against the view of the same field on the CPU: equal, bit for bit,
// right after each scan. Also batch queries on the host, which are the same for both.
#include <gtest/gtest.h>

#include <cmath>

#include "accessvdb/batch_query.h"
#include "parity/gpu_test.h"
#include "parity/view_reads.h"
#include "support/query_world.h"

namespace accessvdb::test {
namespace {

class CudaView : public GpuTest {};

std::vector<ViewQuestion> questionsNear(const FieldSnapshot& snapshot, int count, std::uint64_t seed) {
  const auto a_W = QueryWorld::nearSurface(snapshot, count, 0.3, seed),
             b_W = QueryWorld::nearSurface(snapshot, count, 0.3, seed);
  samples::RandomStream random(seed + 1);
  std::vector<ViewQuestion> questions(a_W.size());
  for (std::size_t n = 0; n < questions.size(); ++n) {
    for (int axis = 0; axis < 3; ++axis) {
      questions[n].a_W[axis] = a_W[n][axis];
      questions[n].b_W[axis] = b_W[n][axis] + random.uniform(-0.4, 0.4);
    }
    questions[n].radius_m = n % 4 == 0 ? 0 : random.uniform(0, 0.25);
  }
  questions[0].a_W[1] = std::nan("");
  questions[1].radius_m = -1;
  return questions;
}

/// The same bits, or both NaN.
bool same(float a, float b) { return std::isnan(a) ? std::isnan(b) : a == b; }

TEST_F(CudaView, EqualsTheHostAfterEveryScan) {
  QueryWorld cpu(0, BackendKind::Cpu, 0, true), cuda(0, BackendKind::Cuda, 0, true);
  const auto backend = kernels::makeCudaBackend();  // only for memory
  for (int n = 0; n < 3; ++n) {
    SCOPED_TRACE(n);
    if (n == 1) {  // only the map is new: points are as of the previous update
      cpu.integrate(5);
      cuda.integrate(5);
    } else if (n == 2) {
      cpu.field.update();
      cuda.field.update();
    }
    const DeviceView host = cpu.field.hostView(), device = cuda.field.deviceView();
    EXPECT_TRUE(device.on_gpu);
    EXPECT_EQ(device.revision, cuda.field.revision());
    ASSERT_EQ(device.points.count, host.points.count);
    const auto questions = questionsNear(cpu.field.snapshot(), 20000, 40 + std::uint64_t(n));
    const auto answers = askOnDevice(*backend, device, questions);
    ASSERT_TRUE(device.distance_available);
    int collisions = 0, unknown = 0, free = 0, distances = 0, interpolated = 0;
    for (std::size_t q = 0; q < questions.size(); ++q) {
      const PathOccupancy expected = host.along(questions[q].a_W, questions[q].b_W, questions[q].radius_m);
      ASSERT_EQ(answers[q].at_a, host.occupancyAt(questions[q].a_W)) << q;
      ASSERT_EQ(answers[q].along.valid, expected.valid) << q;
      ASSERT_EQ(answers[q].along.collision, expected.collision) << q;
      ASSERT_EQ(answers[q].along.unknown, expected.unknown) << q;
      ASSERT_EQ(answers[q].along.first_hit_t, expected.first_hit_t) << q;
      const float distance_m = host.distanceAt(questions[q].a_W);
      const float between_m = host.distanceInterpolatedAt(questions[q].a_W);
      ASSERT_TRUE(same(answers[q].distance_m, distance_m)) << q << " " << answers[q].distance_m << " " << distance_m;
      ASSERT_TRUE(same(answers[q].interpolated_m, between_m)) << q;
      distances += std::isnan(distance_m) ? 0 : 1;
      interpolated += std::isnan(between_m) ? 0 : 1;
      collisions += expected.collision;
      unknown += expected.unknown;
      free += expected.free();
    }
    EXPECT_GT(collisions, 500);
    EXPECT_GT(unknown, 500);
    EXPECT_GT(free, 100);
    EXPECT_GT(distances, 500);
    EXPECT_GT(interpolated, 500);
    EXPECT_GT(distances, interpolated);

    std::vector<PointLabel> labels(device.points.count);
    std::vector<float> positions(3 * labels.size()), table(2 * std::size_t(device.num_directions));
    backend->download(labels.data(), device.points.label, labels.size() * sizeof labels[0]);
    backend->download(positions.data(), device.points.position_L, positions.size() * sizeof positions[0]);
    backend->download(table.data(), device.direction_xy, table.size() * sizeof table[0]);
    for (std::size_t id = 0; id < labels.size(); ++id) {
      ASSERT_EQ(labels[id], host.points.label[id]);
      if (host.points.reason[id] == PointReason::Confidence) continue;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        ASSERT_EQ(positions[3 * id + axis], host.points.position_L[3 * id + axis]);
      }
    }
    for (std::size_t d = 0; d < table.size(); ++d) ASSERT_EQ(table[d], host.direction_xy[d]);
  }
}

TEST_F(CudaView, WithoutTheMirrorOfDistancesThereAreNone) {
  const QueryWorld cuda(0, BackendKind::Cuda);
  const auto backend = kernels::makeCudaBackend();  // only for memory
  const DeviceView device = cuda.field.deviceView();
  EXPECT_FALSE(device.distance_available);
  for (const ViewAnswer& answer : askOnDevice(*backend, device, questionsNear(cuda.field.snapshot(), 100, 3))) {
    ASSERT_TRUE(std::isnan(answer.distance_m));
    ASSERT_TRUE(std::isnan(answer.interpolated_m));
  }
}

TEST_F(CudaView, BatchQueriesAreThoseOfTheCpu) {
  QueryWorld cpu(0, BackendKind::Cpu), cuda(0, BackendKind::Cuda);
  const auto points_W = QueryWorld::nearSurface(cpu.field.snapshot(), 20000, 0.15, 9);
  std::vector<PointAnswer> a(points_W.size()), b(points_W.size());
  cpu.field.batchQuery().at(points_W, a);
  cuda.field.batchQuery().at(points_W, b);
  for (std::size_t n = 0; n < a.size(); ++n) {
    ASSERT_EQ(a[n].point_id, b[n].point_id);
    ASSERT_EQ(a[n].label, b[n].label);
    ASSERT_EQ(a[n].reason, b[n].reason);
    ASSERT_EQ(a[n].direction, b[n].direction);
    ASSERT_EQ(a[n].score, b[n].score);
    ASSERT_EQ(a[n].weight, b[n].weight);
  }
}

TEST_F(CudaView, HostViewOfTheGpuIsRefused) {
  const QueryWorld cuda(0, BackendKind::Cuda);
  try {
    (void)cuda.field.hostView();
    FAIL() << "no error";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.id(), "device.not_host");
  }
}

}  // namespace
}  // namespace accessvdb::test
