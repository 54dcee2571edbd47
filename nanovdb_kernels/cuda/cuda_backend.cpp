// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "cuda/cuda_backend.h"

#include <algorithm>
#include <array>
#include <cstring>

#include "cuda/memory/cuda_check.h"
#include "cuda/memory/device_arena.h"
#include "cuda/memory/device_context.h"
#include "cuda/memory/owned_event.h"
#include "cuda/memory/pinned_buffer.h"
#include "cuda/search/score_kernels.h"
#include "cuda/search/told_points.h"
#include "cuda/search/tool_fits.h"
#include "cuda/update/updaters.h"

namespace accessvdb::kernels {
namespace {

constexpr std::uint32_t kLeastChunk = 256;
/// Fewer items are not worth sorting.
constexpr std::uint32_t kLeastToOrder = 64;

struct Events {
  std::array<OwnedEvent, 4> event = {OwnedEvent(cudaEventDefault), OwnedEvent(cudaEventDefault),
                                     OwnedEvent(cudaEventDefault), OwnedEvent(cudaEventDefault)};
  [[nodiscard]] float between(std::size_t from, std::size_t to) const {
    float ms = 0;
    ACCESSVDB_CUDA(cudaEventElapsedTime(&ms, event[from].get(), event[to].get()));
    return ms;
  }
};

/// Device memory that only grows.
class GrowingMemory {
 public:
  explicit GrowingMemory(DeviceContext& context) : context_(context) {}
  ~GrowingMemory() { context_.release(address_, bytes_); }
  GrowingMemory(const GrowingMemory&) = delete;
  GrowingMemory& operator=(const GrowingMemory&) = delete;
  void reserve(std::size_t bytes) {
    if (bytes <= bytes_) return;
    context_.release(address_, bytes_);
    address_ = nullptr;
    bytes_ = 0;
    address_ = static_cast<std::byte*>(context_.allocate(bytes));
    bytes_ = bytes;
  }
  [[nodiscard]] std::byte* data() const { return address_; }

 private:
  DeviceContext& context_;
  std::byte* address_ = nullptr;
  std::size_t bytes_ = 0;
};

/// A chunk in flight: its stream, and memory on both sides.
struct Slot {
  explicit Slot(DeviceContext& context) : memory(context) {
    ACCESSVDB_CUDA(cudaStreamCreateWithFlags(&stream, cudaStreamNonBlocking));
  }
  ~Slot() {
    if (stream != nullptr) (void)cudaStreamDestroy(stream);
  }
  Slot(const Slot&) = delete;
  Slot& operator=(const Slot&) = delete;

  cudaStream_t stream = nullptr;
  PinnedBuffer host;
  GrowingMemory memory;
  Events events;
  std::size_t first = 0;    ///< index of the first item
  std::uint32_t count = 0;  ///< number of items
  std::uint32_t room = 0;   ///< items that memory was laid out for
};

/// Offsets of a chunk's parts in one allocation.
struct Layout {
  std::size_t items = 0, results = 0, keys = 0, sorted = 0, order_in = 0, order = 0, scratch = 0, bytes = 0;

  Layout(std::uint32_t count, std::size_t result_bytes, std::size_t scratch_bytes) {
    std::size_t top = 0;
    const auto place = [&](std::size_t size) {
      const std::size_t at = top;
      top += (size + 255) / 256 * 256;
      return at;
    };
    items = place(count * sizeof(ScoreItem));
    results = place(count * result_bytes);
    for (std::size_t* list : {&keys, &sorted, &order_in, &order}) *list = place(count * sizeof(std::uint32_t));
    scratch = place(scratch_bytes);
    bytes = top;
  }
};

class Implementation final : public CudaBackend {
 public:
  explicit Implementation(const CudaOptions& options)
      : options_(options), context_(std::make_shared<DeviceContext>(options.memory_limit_bytes)) {
    requireScoreKernels(context_->sharedBytesPerBlock());
    chunk_ = std::max(options_.chunk_items, kLeastChunk);
    for (auto& slot : slots_) slot = std::make_unique<Slot>(*context_);
  }

  std::string name() const override { return "cuda:" + context_->name(); }
  std::uint64_t peakBytes() const override { return context_->peakBytes(); }
  std::uint64_t heldBytes() const override { return context_->bytes(); }
  std::uint64_t freeBytes() const override {
    const CurrentDevice current(context_->device());
    std::size_t free = 0, all = 0;
    ACCESSVDB_CUDA(cudaMemGetInfo(&free, &all));
    return free;
  }
  std::uint64_t pinnedBytes() const override {
    return context_->pinnedBytes() + slots_[0]->host.size() + slots_[1]->host.size();
  }
  std::uint64_t allocations() const override { return context_->allocations(); }
  DeviceTimes lastTimes() const override { return times_; }
  void setTiming(bool on) override { timing_ = on; }
  void setPath(SearchPath path) override { options_.path = path; }
  void finish() override {
    const CurrentDevice current(context_->device());
    ACCESSVDB_CUDA(cudaDeviceSynchronize());
  }

  std::unique_ptr<MirrorArena> makeArena() override { return std::make_unique<DeviceArena>(context_); }
  void waitForMirror() override {
    const CurrentDevice current(context_->device());
    ACCESSVDB_CUDA(cudaEventSynchronize(context_->mirrorReady()));
  }

  void* allocate(std::size_t bytes) override { return context_->allocate(bytes); }
  void release(void* address, std::size_t bytes) noexcept override { context_->release(address, bytes); }
  void upload(void* to, const void* from, std::size_t bytes) override {
    transfer(to, from, bytes, cudaMemcpyHostToDevice);
  }
  void download(void* to, const void* from, std::size_t bytes) override {
    transfer(to, from, bytes, cudaMemcpyDeviceToHost);
  }
  void copy(void* to, const void* from, std::size_t bytes) override {
    transfer(to, from, bytes, cudaMemcpyDeviceToDevice);
  }

  void writePoints(const PointStateView& points, const PointInput* inputs, std::size_t count) override {
    const CurrentDevice current(context_->device());
    inChunks(
        count,
        [&](Slot& slot, std::uint32_t chunk) { reserve(slot, chunk * sizeof(PointInput), chunk * sizeof(PointInput)); },
        [&](Slot& slot) {
          const std::size_t bytes = slot.count * sizeof(PointInput);
          std::memcpy(slot.host.data(), inputs + slot.first, bytes);
          ACCESSVDB_CUDA(
              cudaMemcpyAsync(slot.memory.data(), slot.host.data(), bytes, cudaMemcpyHostToDevice, slot.stream));
          launchWrite(points, reinterpret_cast<const PointInput*>(slot.memory.data()), slot.count, slot.stream);
        },
        [](Slot&) {});
  }

  void writeSeen(const PointStateView& points, const std::uint32_t* ids, const std::uint64_t* rows,
                 std::size_t count) override {
    const CurrentDevice current(context_->device());
    const std::size_t row_bytes = static_cast<std::size_t>(points.direction_words) * sizeof(std::uint64_t);
    const auto bytesOf = [&](std::size_t rows_of_chunk) { return rows_of_chunk * (row_bytes + sizeof(std::uint32_t)); };
    inChunks(
        count, [&](Slot& slot, std::uint32_t chunk) { reserve(slot, bytesOf(chunk), bytesOf(chunk)); },
        [&](Slot& slot) {
          const std::size_t words_bytes = slot.count * row_bytes, bytes = bytesOf(slot.count);
          const std::size_t words = static_cast<std::size_t>(points.direction_words);
          std::memcpy(slot.host.data(), rows + slot.first * words, words_bytes);
          std::memcpy(slot.host.data() + words_bytes, ids + slot.first, bytes - words_bytes);
          ACCESSVDB_CUDA(
              cudaMemcpyAsync(slot.memory.data(), slot.host.data(), bytes, cudaMemcpyHostToDevice, slot.stream));
          launchWriteSeen(points,
                          {reinterpret_cast<const std::uint32_t*>(slot.memory.data() + words_bytes),
                           reinterpret_cast<const std::uint64_t*>(slot.memory.data()), slot.count},
                          slot.stream);
        },
        [](Slot&) {});
  }

  void readPoints(const PointStateView& points, const std::uint32_t* ids, StateRow* rows, std::size_t count) override {
    const CurrentDevice current(context_->device());
    constexpr std::size_t kBoth = sizeof(StateRow) + sizeof(std::uint32_t);
    inChunks(
        count, [&](Slot& slot, std::uint32_t chunk) { reserve(slot, chunk * kBoth, chunk * kBoth); },
        [&](Slot& slot) {
          const std::size_t row_bytes = slot.count * sizeof(StateRow), id_bytes = slot.count * sizeof(std::uint32_t);
          std::memcpy(slot.host.data() + row_bytes, ids + slot.first, id_bytes);
          ACCESSVDB_CUDA(cudaMemcpyAsync(slot.memory.data() + row_bytes, slot.host.data() + row_bytes, id_bytes,
                                         cudaMemcpyHostToDevice, slot.stream));
          launchReadRows(points, reinterpret_cast<const std::uint32_t*>(slot.memory.data() + row_bytes),
                         reinterpret_cast<StateRow*>(slot.memory.data()), slot.count, slot.stream);
          ACCESSVDB_CUDA(
              cudaMemcpyAsync(slot.host.data(), slot.memory.data(), row_bytes, cudaMemcpyDeviceToHost, slot.stream));
        },
        [&](Slot& slot) {
          std::memcpy(static_cast<void*>(rows + slot.first), slot.host.data(), slot.count * sizeof(StateRow));
        });
  }

  void takeAllTold(const PointStateView& points, const ToldStates& states) override {
    const CurrentDevice current(context_->device());
    launchTakeTold(points, states, context_->stream());
    ACCESSVDB_CUDA(cudaStreamSynchronize(context_->stream()));
  }

  void scorePoints(const ScoreRequest& request) override {
    search(request, sizeof(ScoreResult), request.results,
           [&](const ScoreChunk& chunk, const WindowPlan& window, const Slot& slot) {
             if (isWide(request.approach.num_directions)) {
               launchWideSearch(chunk, window, context_->sharedBytesPerBlock(), slot.stream);
             } else if (options_.path == SearchPath::Plain) {
               launchPlainSearch(chunk, slot.stream);
             } else {
               launchWarpSearch(chunk, window, slot.stream);
             }
             mark(slot, 2);
             launchUpdate(chunk, slot.stream);
           });
  }

  void fitTool(const FitRequest& request) override {
    if (request.count == 0) return;
    DeviceArray<ToolPlace> places;
    DeviceArray<ToolFit> fits;
    places.grow(*this, request.count, 0);
    fits.grow(*this, request.count, 0);
    places.upload(request.places, request.count);
    FitRequest on_device = request;
    on_device.places = places.data();
    on_device.fits = fits.data();
    {
      const CurrentDevice current(context_->device());
      launchToolFits(on_device, context_->stream());
    }
    download(request.fits, fits.data(), request.count * sizeof(ToolFit));
  }

  bool usesToolSlabs() const override { return true; }
  std::unique_ptr<ExactUpdater> makeExactUpdater(const ExactTables& tables) override {
    return kernels::makeExactUpdater(context_, *this, tables);
  }
  std::unique_ptr<ScanFuser> makeScanFuser(const FusionSetting& setting, const OccupancyGrid* grid) override {
    return makeDeviceScanFuser(setting, grid);
  }
  std::unique_ptr<DeviceScanFuser> makeDeviceScanFuser(const FusionSetting& setting,
                                                       const OccupancyGrid* grid) override {
    return kernels::makeScanFuser(context_, *this, setting, grid);
  }
  std::unique_ptr<PaperUpdater> makePaperUpdater(const PaperTables& tables) override {
    return kernels::makePaperUpdater(context_, *this, tables);
  }

  void countCollisions(const ScoreRequest& request, std::uint16_t* counts) override {
    const auto directions = static_cast<std::size_t>(request.approach.num_directions);
    search(request, directions * sizeof(std::uint16_t), counts,
           [&](const ScoreChunk& chunk, const WindowPlan& window, const Slot& slot) {
             launchCount(chunk, window, reinterpret_cast<std::uint16_t*>(chunk.results), slot.stream);
             mark(slot, 2);
           });
  }

 private:
  void transfer(void* to, const void* from, std::size_t bytes, cudaMemcpyKind kind) {
    if (bytes == 0) return;
    const CurrentDevice current(context_->device());
    ACCESSVDB_CUDA(cudaMemcpyAsync(to, from, bytes, kind, context_->stream()));
    ACCESSVDB_CUDA(cudaStreamSynchronize(context_->stream()));
  }

  static void reserve(Slot& slot, std::size_t host_bytes, std::size_t device_bytes) {
    slot.memory.reserve(device_bytes);
    slot.host.reserve(host_bytes);
  }

  /// Splits `count` items into chunks and keeps two in flight: the host works on one while the device works on the
  /// other. Without memory for a chunk, retries with half of it, down to kLeastChunk.
  template <class Reserve, class Send, class Take>
  void inChunks(std::size_t count, const Reserve& reserve_chunk, const Send& send, const Take& take) {
    std::size_t first = 0;
    std::array<bool, 2> busy = {false, false};
    try {
      for (std::size_t turn = 0; first < count || busy[0] || busy[1]; turn = 1 - turn) {
        Slot& slot = *slots_[turn];
        if (busy[turn]) {
          ACCESSVDB_CUDA(cudaStreamSynchronize(slot.stream));
          take(slot);
          busy[turn] = false;
        }
        if (first == count) continue;
        while (true) {
          slot.first = first;
          slot.count = static_cast<std::uint32_t>(std::min<std::size_t>(count - first, chunk_));
          try {
            reserve_chunk(slot, slot.count);
            break;
          } catch (const ResourceLimit&) {
            if (slot.count <= kLeastChunk) throw;
            chunk_ = std::max(slot.count / 2, kLeastChunk);
          }
        }
        send(slot);
        busy[turn] = true;
        first += slot.count;
      }
    } catch (...) {
      for (const auto& slot : slots_) (void)cudaStreamSynchronize(slot->stream);  // nothing may write after the throw
      throw;
    }
  }

  void mark(const Slot& slot, int n) const {
    if (timing_) ACCESSVDB_CUDA(cudaEventRecord(slot.events.event[static_cast<std::size_t>(n)].get(), slot.stream));
  }

  /// Sends items, calls `launch`, and brings back `result_bytes` of results per item.
  template <class Launch>
  void search(const ScoreRequest& request, std::size_t result_bytes, void* results, const Launch& launch) {
    const CurrentDevice current(context_->device());
    times_ = {};
    WindowPlan window;
    if (options_.path == SearchPath::Fast || options_.path == SearchPath::Lowers) {
      window = planWindow(request.tool, context_->sharedBytesPerBlock(), options_.path == SearchPath::Fast);
    }
    const auto scratchFor = [](std::uint32_t count) {
      ScoreChunk chunk;
      chunk.count = count;
      std::size_t bytes = 0;
      launchLeafOrder(chunk, nullptr, nullptr, nullptr, nullptr, nullptr, bytes, nullptr);
      return bytes;
    };
    inChunks(
        request.count,
        [&](Slot& slot, std::uint32_t count) {
          // Grows in steps, so that small differences between frames allocate nothing.
          slot.room = kLeastChunk;
          while (slot.room < count) slot.room *= 2;
          const Layout layout(slot.room, result_bytes, scratchFor(slot.room));
          reserve(slot, slot.room * (sizeof(ScoreItem) + result_bytes), layout.bytes);
        },
        [&](Slot& slot) {
          std::size_t scratch_bytes = scratchFor(slot.room);
          const Layout layout(slot.room, result_bytes, scratch_bytes);
          std::byte* const memory = slot.memory.data();
          const auto list = [&](std::size_t at) { return reinterpret_cast<std::uint32_t*>(memory + at); };
          std::memcpy(slot.host.data(), request.items + slot.first, slot.count * sizeof(ScoreItem));
          ACCESSVDB_CUDA(cudaStreamWaitEvent(slot.stream, context_->mirrorReady()));
          ACCESSVDB_CUDA(cudaMemcpyAsync(memory + layout.items, slot.host.data(), slot.count * sizeof(ScoreItem),
                                         cudaMemcpyHostToDevice, slot.stream));
          ScoreChunk chunk;
          chunk.map = request.map;
          chunk.tool = request.tool;
          chunk.approach = request.approach;
          chunk.points = request.points;
          chunk.rule = request.rule;
          chunk.items = reinterpret_cast<const ScoreItem*>(memory + layout.items);
          chunk.results = reinterpret_cast<ScoreResult*>(memory + layout.results);
          chunk.count = slot.count;
          // Results have padding between fields; zero it, so that all bytes copied are defined.
          ACCESSVDB_CUDA(cudaMemsetAsync(memory + layout.results, 0, slot.count * result_bytes, slot.stream));
          mark(slot, 0);
          if (window.kind != WindowPlan::Kind::None && slot.count >= kLeastToOrder) {
            launchLeafOrder(chunk, list(layout.keys), list(layout.sorted), list(layout.order_in), list(layout.order),
                            memory + layout.scratch, scratch_bytes, slot.stream);
            chunk.order = list(layout.order);
          }
          mark(slot, 1);
          launch(chunk, window, slot);
          mark(slot, 3);
          ACCESSVDB_CUDA(cudaMemcpyAsync(slot.host.data() + slot.count * sizeof(ScoreItem), memory + layout.results,
                                         slot.count * result_bytes, cudaMemcpyDeviceToHost, slot.stream));
        },
        [&](Slot& slot) {
          std::memcpy(static_cast<std::byte*>(results) + slot.first * result_bytes,
                      slot.host.data() + slot.count * sizeof(ScoreItem), slot.count * result_bytes);
          if (!timing_) return;
          times_.order_ms += slot.events.between(0, 1);
          times_.search_ms += slot.events.between(1, 2);
          times_.update_ms += slot.events.between(2, 3);
        });
  }

  CudaOptions options_;
  std::shared_ptr<DeviceContext> context_;
  std::array<std::unique_ptr<Slot>, 2> slots_;
  std::uint32_t chunk_ = 0;
  DeviceTimes times_;
  bool timing_ = false;
};

}  // namespace

std::unique_ptr<CudaBackend> makeCudaBackend(const CudaOptions& options) {
  return std::make_unique<Implementation>(options);
}
std::unique_ptr<Backend> makeCudaBackend() { return makeCudaBackend(CudaOptions{}); }

}  // namespace accessvdb::kernels
