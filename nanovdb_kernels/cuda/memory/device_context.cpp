// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "cuda/memory/device_context.h"

#include <filesystem>
#include <system_error>

#include "cuda/memory/cuda_check.h"

namespace accessvdb::kernels {
namespace {

std::string versionText(int version) {
  return std::to_string(version / 1000) + "." + std::to_string(version % 1000 / 10);
}

[[noreturn]] void refuse(const std::string& id, const std::string& problem, const std::string& advice) {
  (void)cudaGetLastError();
  throw DeviceError(id, "cuda", problem, advice);
}

/// One message per reason why there is no usable device.
void requireDriverAndDevice() {
  int driver = 0, runtime = 0, devices = 0;
  if (cudaDriverGetVersion(&driver) != cudaSuccess || driver == 0) {
    // As in a container that was started without the GPU: the kernel has its part of the driver, the rest is not here.
    std::error_code ignored;
    if (std::filesystem::exists("/proc/driver/nvidia/version", ignored)) {
      refuse("device.no_library", "the NVIDIA driver is loaded, but its library libcuda.so.1 is missing here",
             "In a container ask for the GPU when it is started, else install libcuda1, or use BackendKind::Cpu");
    }
    refuse("device.no_driver", "no NVIDIA driver is installed", "Install one, or use BackendKind::Cpu");
  }
  ACCESSVDB_CUDA(cudaRuntimeGetVersion(&runtime));
  const cudaError_t status = cudaGetDeviceCount(&devices);
  if (status == cudaErrorInsufficientDriver) {
    refuse("device.old_driver",
           "the NVIDIA driver knows CUDA " + versionText(driver) + ", this program needs " + versionText(runtime),
           "Install a newer driver, or use BackendKind::Cpu");
  }
  if (status == cudaErrorNoDevice || (status == cudaSuccess && devices == 0)) {
    refuse("device.missing", "no NVIDIA GPU can be used here",
           "Check nvidia-smi and CUDA_VISIBLE_DEVICES, or use BackendKind::Cpu");
  }
  if (status != cudaSuccess) {
    refuse("device.failed", std::string("the NVIDIA driver does not start: ") + cudaGetErrorString(status),
           "Check nvidia-smi, or use BackendKind::Cpu");
  }
}

}  // namespace

CurrentDevice::CurrentDevice(int device) {
  ACCESSVDB_CUDA(cudaGetDevice(&before_));
  if (before_ != device) {
    ACCESSVDB_CUDA(cudaSetDevice(device));
  } else {
    before_ = -1;
  }
}
CurrentDevice::~CurrentDevice() {
  if (before_ >= 0) (void)cudaSetDevice(before_);
}

DeviceContext::DeviceContext(std::uint64_t memory_limit_bytes) : limit_bytes_(memory_limit_bytes) {
  requireDriverAndDevice();
  ACCESSVDB_CUDA(cudaGetDevice(&device_));  // the caller's current device, else the first
  try {
    describeDevice();
    for (cudaStream_t* stream : {&stream_, &beside_stream_}) {
      ACCESSVDB_CUDA(cudaStreamCreateWithFlags(stream, cudaStreamNonBlocking));
    }
    int least = 0, greatest = 0;
    ACCESSVDB_CUDA(cudaDeviceGetStreamPriorityRange(&least, &greatest));
    ACCESSVDB_CUDA(cudaStreamCreateWithPriority(&priority_stream_, cudaStreamNonBlocking, greatest));
    ACCESSVDB_CUDA(cudaEventCreateWithFlags(&mirror_ready_, cudaEventDisableTiming));
  } catch (const ResourceLimit& error) {
    closeStreams();
    refuse("device.memory", error.problem(), "Free the GPU of other work, or use BackendKind::Cpu");
  } catch (...) {
    closeStreams();
    throw;
  }
}

DeviceContext::~DeviceContext() { closeStreams(); }

void DeviceContext::closeStreams() noexcept {
  if (mirror_ready_ != nullptr) (void)cudaEventDestroy(mirror_ready_);
  for (cudaStream_t stream : {priority_stream_, beside_stream_, stream_}) {
    if (stream != nullptr) (void)cudaStreamDestroy(stream);
  }
}

void DeviceContext::describeDevice() {
  cudaDeviceProp properties = {};
  ACCESSVDB_CUDA(cudaGetDeviceProperties(&properties, device_));
  name_ = properties.name;
  shared_bytes_per_block_ = static_cast<int>(properties.sharedMemPerBlockOptin);
  multiprocessors_ = properties.multiProcessorCount;
}

void* DeviceContext::allocate(std::size_t bytes) {
  count(static_cast<std::int64_t>(bytes));
  const CurrentDevice current(device_);
  void* address = nullptr;
  const cudaError_t status = cudaMalloc(&address, bytes == 0 ? 1 : bytes);
  if (status != cudaSuccess) {
    count(-static_cast<std::int64_t>(bytes));
    if (status == cudaErrorMemoryAllocation) {
      (void)cudaGetLastError();
      throwDeviceMemory("no device memory for " + std::to_string(bytes) + " bytes more; this field holds " +
                        std::to_string(this->bytes() >> 20) + " MiB");
    }
    checkCuda(status, "cudaMalloc");
  }
  const std::lock_guard lock(mutex_);
  ++allocations_;
  return address;
}

void DeviceContext::release(void* address, std::size_t bytes) noexcept {
  if (address == nullptr) return;
  {
    const std::lock_guard lock(mutex_);
    bytes_ -= bytes;
  }
  // Ignore failures: a lost device or an exiting process frees its memory anyway.
  if (cudaFree(address) != cudaSuccess) (void)cudaGetLastError();
}

void DeviceContext::count(std::int64_t bytes) {
  const std::lock_guard lock(mutex_);
  const std::uint64_t after = bytes_ + static_cast<std::uint64_t>(bytes);
  if (bytes > 0 && limit_bytes_ > 0 && after > limit_bytes_) {
    throwDeviceMemory("no device memory for " + std::to_string(bytes) + " bytes more below the limit of " +
                      std::to_string(limit_bytes_ >> 20) + " MiB");
  }
  bytes_ = after;
  if (bytes_ > peak_bytes_) peak_bytes_ = bytes_;
}

void DeviceContext::countPinned(std::int64_t bytes) {
  const std::lock_guard lock(mutex_);
  pinned_bytes_ += static_cast<std::uint64_t>(bytes);
}

std::uint64_t DeviceContext::bytes() const {
  const std::lock_guard lock(mutex_);
  return bytes_;
}
std::uint64_t DeviceContext::peakBytes() const {
  const std::lock_guard lock(mutex_);
  return peak_bytes_;
}
std::uint64_t DeviceContext::pinnedBytes() const {
  const std::lock_guard lock(mutex_);
  return pinned_bytes_;
}
std::uint64_t DeviceContext::allocations() const {
  const std::lock_guard lock(mutex_);
  return allocations_;
}

}  // namespace accessvdb::kernels
