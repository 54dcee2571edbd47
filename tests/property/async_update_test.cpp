// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// updateAsync() gives the same bits as update(), whatever is called in between, and nothing is lost when its field or
/// its ticket goes first. The oracle is a field that only ever calls update().
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>
#include <utility>

#include "accessvdb/batch_query.h"
#include "accessvdb/surface_points.h"
#include "support/determinism_support.h"
#include "support/same_map.h"
#include "support/scratch_folder.h"

namespace accessvdb::test {
namespace {

struct AsyncCase {
  const char* name;
  UpdatePolicy policy;
  int threads;
  int budget_points = 0;
};
void PrintTo(const AsyncCase& c, std::ostream* out) { *out << c.name; }

FieldParams paramsOf(const AsyncCase& c) {
  FieldParams params;
  params.tsdf.voxel_size_m = 0.05;
  params.threads = c.threads;
  params.update.policy = c.policy;
  params.update.budget_points = c.budget_points;
  params.backend = BackendKind::Cpu;
  return params;
}

void expectSameWork(const UpdateStats& a, const UpdateStats& b) {
  EXPECT_EQ(a.dirty_points, b.dirty_points);
  EXPECT_EQ(a.moved_points, b.moved_points);
  EXPECT_EQ(a.scored_points, b.scored_points);
  EXPECT_EQ(a.direction_tests, b.direction_tests);
  EXPECT_EQ(a.label_changes, b.label_changes);
  EXPECT_EQ(a.backlog, b.backlog);
}
void expectSameScan(const FrameStats& a, const FrameStats& b) {
  EXPECT_EQ(a.points_used, b.points_used);
  EXPECT_EQ(a.touched_leaves, b.touched_leaves);
  EXPECT_EQ(a.new_leaves, b.new_leaves);
  EXPECT_EQ(a.changed_leaves, b.changed_leaves);
  EXPECT_EQ(a.flipped_voxels, b.flipped_voxels);
  EXPECT_EQ(a.surface_points, b.surface_points);
}

std::string bytesOf(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

class AsyncUpdate : public testing::TestWithParam<AsyncCase> {};

TEST_P(AsyncUpdate, SameBitsWhateverIsCalledInBetween) {
  const FieldParams params = paramsOf(GetParam());
  const ScratchFolder folder;
  const std::vector<Scan> scans = wallScans(3, 9, 300);
  int interleaved = 0;
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937_64 random(seed);
    AccessibilityField expected(armTool(), params), field(armTool(), params);
    UpdateTicket ticket;
    std::optional<UpdateStats> awaited;  // what the ticket has to say
    for (std::size_t n = 0; n < scans.size(); ++n) {
      const Scan& scan = scans[n];
      expectSameScan(field.integrateScan(scan.points_S, scan.T_W_S), expected.integrateScan(scan.points_S, scan.T_W_S));
      if (random() % 5 == 0) continue;  // two scans before an update
      if (awaited && random() % 2 == 0) expectSameWork(ticket.wait(), *awaited);
      awaited = expected.update();
      if (random() % 4 == 0) {
        expectSameWork(field.update(), *awaited);
        awaited.reset();
        ticket = {};
      } else {
        ticket = field.updateAsync();
        ++interleaved;
      }
      switch (random() % 8) {
        case 0:
          expectSame(field.snapshot(), expected.snapshot());
          break;
        case 1:
          expectSame(field.unscoredSnapshot(), expected.unscoredSnapshot());
          break;
        case 2:
          EXPECT_EQ(field.memoryUse().leaves, expected.memoryUse().leaves);
          EXPECT_EQ(field.volume().activeVoxelCount(), expected.volume().activeVoxelCount());
          break;
        case 3: {
          const Eigen::Vector3d p_W(2, 0.5, 1);
          EXPECT_EQ(field.pointAt(p_W).has_value(), expected.pointAt(p_W).has_value());
          EXPECT_EQ(field.batchQuery().at(p_W).front().label, expected.batchQuery().at(p_W).front().label);
          break;
        }
        case 4: {
          AccessibilityField moved = std::move(field);
          field = std::move(moved);
          break;
        }
        case 5:
          ticket = {};  // waits
          awaited.reset();
          break;
        case 6:
          if (GetParam().policy == UpdatePolicy::Exact) {
            field.saveState(folder / "a");
            expected.saveState(folder / "b");
            EXPECT_EQ(bytesOf(folder / "a"), bytesOf(folder / "b"));
          }
          break;
        default:
          break;  // the next scan comes beside the update
      }
      if (HasFatalFailure()) return;
    }
    if (awaited) expectSameWork(ticket.wait(), *awaited);
    expectSame(field.snapshot(), expected.snapshot());
    expectSameMap(field.volume(), expected.volume());
    if (GetParam().budget_points == 0) expectVaried(field.snapshot());
    if (HasFatalFailure()) return;
  }
  EXPECT_GT(interleaved, 10);
}

TEST_P(AsyncUpdate, OutlivesItsFieldAndItsTicket) {
  const FieldParams params = paramsOf(GetParam());
  const std::vector<Scan> scans = wallScans(4, 2, 450);
  AccessibilityField expected(armTool(), params);
  const auto fuse = [&](AccessibilityField& field) {
    for (const Scan& scan : scans) field.integrateScan(scan.points_S, scan.T_W_S);
  };
  fuse(expected);
  const UpdateStats work = expected.update();
  EXPECT_GT(work.scored_points, 0u);
  UpdateTicket ticket;
  {
    AccessibilityField field(armTool(), params);
    fuse(field);
    ticket = field.updateAsync();
  }  // the field waits
  EXPECT_TRUE(ticket.done());
  expectSameWork(ticket.wait(), work);
  expectSameWork(ticket.wait(), work);

  AccessibilityField field(armTool(), params);
  fuse(field);
  { const UpdateTicket dropped = field.updateAsync(); }  // the ticket waits
  expectSame(field.snapshot(), expected.snapshot());

  AccessibilityField other(armTool(), params);
  fuse(other);
  UpdateTicket first = other.updateAsync();
  other = std::move(field);  // what `other` was waits, and is gone
  expectSameWork(first.wait(), work);
  expectSame(other.snapshot(), expected.snapshot());
  // One after the other; the second finds nothing to do.
  const UpdateTicket again = other.updateAsync(), once_more = other.updateAsync();
  EXPECT_TRUE(again.done());
  if (GetParam().policy == UpdatePolicy::Exact && GetParam().budget_points == 0) {
    EXPECT_EQ(once_more.wait().label_changes, 0u);
  }
}

INSTANTIATE_TEST_SUITE_P(Policies, AsyncUpdate,
                         testing::Values(AsyncCase{"exact", UpdatePolicy::Exact, 0},
                                         AsyncCase{"exact_one_thread", UpdatePolicy::Exact, 1},
                                         AsyncCase{"exact_with_a_budget", UpdatePolicy::Exact, 2, 150},
                                         AsyncCase{"paper", UpdatePolicy::Paper, 0},
                                         AsyncCase{"paper_one_thread", UpdatePolicy::Paper, 1},
                                         AsyncCase{"paper_four_threads", UpdatePolicy::Paper, 4, 200}),
                         [](const auto& each) { return each.param.name; });

}  // namespace
}  // namespace accessvdb::test
