// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The CPU backend: runs the rules of hostdev/ under TBB. Has no rules of its own and no OpenVDB.
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <cstring>
#include <new>

#include "accessvdb/error.h"
#include "cpu/host_arena.h"
#include "launch/backend.h"

namespace accessvdb::kernels {
namespace {

/// Items per task: a blocked point costs up to a millisecond, a free one a microsecond.
constexpr std::size_t kItemsPerTask = 32;

class CpuBackend final : public Backend {
 public:
  std::string name() const override { return "cpu"; }

  std::unique_ptr<MirrorArena> makeArena() override { return std::make_unique<HostArena>(); }

  void* allocate(std::size_t bytes) override {
    void* address = ::operator new (bytes == 0 ? 1 : bytes, std::align_val_t{64}, std::nothrow);
    if (address == nullptr) {
      throw ResourceLimit("memory.points", "", "no memory for " + std::to_string(bytes) + " bytes of point state",
                          "Use a larger voxel size");
    }
    return address;
  }
  void release(void* address, std::size_t) noexcept override { ::operator delete (address, std::align_val_t{64}); }
  void upload(void* to, const void* from, std::size_t bytes) override { std::memcpy(to, from, bytes); }
  void download(void* to, const void* from, std::size_t bytes) override { std::memcpy(to, from, bytes); }
  void copy(void* to, const void* from, std::size_t bytes) override { std::memcpy(to, from, bytes); }

  void writePoints(const PointStateView& points, const PointInput* inputs, std::size_t count) override {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, 1024), [&](const auto& range) {
      for (std::size_t n = range.begin(); n != range.end(); ++n) writePoint(points, inputs[n]);
    });
  }

  void scorePoints(const ScoreRequest& request) override {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, request.count, kItemsPerTask), [&](const auto& range) {
      const OccupancyReader map(request.map);
      const PointStateView& points = request.points;
      for (std::size_t n = range.begin(); n != range.end(); ++n) {
        const ScoreItem& item = request.items[n];
        const std::size_t id = item.id;
        request.results[n] = searchDirections(
            map, request.map.inverse_voxel_size, request.tool, request.approach, points.position_L + 3 * id,
            points.normal_L + 3 * id, points.seen + id * static_cast<std::size_t>(points.direction_words), item);
        updatePoint(points, item, request.results[n], request.rule);
      }
    });
  }
};

}  // namespace

std::unique_ptr<Backend> makeCpuBackend() { return std::make_unique<CpuBackend>(); }

}  // namespace accessvdb::kernels
