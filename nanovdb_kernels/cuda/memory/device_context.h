// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The device of a backend: its streams, memory and peak memory use.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>
#include <mutex>
#include <string>

namespace accessvdb::kernels {

/// Makes a device current for the calling thread; the destructor restores the previous one.
class CurrentDevice {
 public:
  explicit CurrentDevice(int device);
  ~CurrentDevice();
  CurrentDevice(const CurrentDevice&) = delete;
  CurrentDevice& operator=(const CurrentDevice&) = delete;

 private:
  int before_ = -1;
};

/// Shared by a backend and its arenas. Counting is thread-safe.
class DeviceContext {
 public:
  /// @param memory_limit_bytes  most bytes to hold at a time; for tests of running out of memory
  /// @throw DeviceError  no driver, no device, a driver too old for the runtime, or no code for its architecture
  explicit DeviceContext(std::uint64_t memory_limit_bytes);
  ~DeviceContext();
  DeviceContext(const DeviceContext&) = delete;
  DeviceContext& operator=(const DeviceContext&) = delete;

  [[nodiscard]] int device() const { return device_; }
  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] int multiprocessors() const { return multiprocessors_; }
  [[nodiscard]] int sharedBytesPerBlock() const { return shared_bytes_per_block_; }
  [[nodiscard]] cudaStream_t stream() const { return stream_; }  ///< for all other work
  /// For mirror writes, work that needs only the mirror, and long searches. Has priority over stream().
  [[nodiscard]] cudaStream_t priorityStream() const { return priority_stream_; }
  /// For work that leaves part of the device to stream(), and is joined with it by events.
  [[nodiscard]] cudaStream_t besideStream() const { return beside_stream_; }
  [[nodiscard]] cudaEvent_t mirrorReady() const { return mirror_ready_; }  ///< recorded after the last flush

  /// @throw ResourceLimit
  void* allocate(std::size_t bytes);
  /// @param bytes  as passed to allocate(). A null address is ignored.
  void release(void* address, std::size_t bytes) noexcept;
  /// Counts bytes gained or lost other than by allocate() and release(). @throw ResourceLimit over the limit
  void count(std::int64_t bytes);
  /// The same for host memory of arenas, which has no limit.
  void countPinned(std::int64_t bytes);

  [[nodiscard]] std::uint64_t bytes() const;
  [[nodiscard]] std::uint64_t peakBytes() const;
  [[nodiscard]] std::uint64_t pinnedBytes() const;
  [[nodiscard]] std::uint64_t allocations() const;  ///< that reached the driver

 private:
  void describeDevice();
  void closeStreams() noexcept;

  int device_ = 0;
  int shared_bytes_per_block_ = 0, multiprocessors_ = 1;
  std::string name_;
  std::uint64_t limit_bytes_;
  cudaStream_t stream_ = nullptr, priority_stream_ = nullptr, beside_stream_ = nullptr;
  cudaEvent_t mirror_ready_ = nullptr;
  mutable std::mutex mutex_;
  std::uint64_t bytes_ = 0, peak_bytes_ = 0, pinned_bytes_ = 0, allocations_ = 0;
};

}  // namespace accessvdb::kernels
