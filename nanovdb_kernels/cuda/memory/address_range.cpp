// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "cuda/memory/address_range.h"

#include <cuda.h>

#include <algorithm>
#include <string>

#include "cuda/memory/cuda_check.h"

namespace accessvdb::kernels {
namespace {

constexpr std::uint64_t kLeastReserve = std::uint64_t(1) << 30;
// Each step costs time, and may leave up to its size unused.
constexpr std::uint64_t kLeastStep = std::uint64_t(4) << 20;
constexpr std::uint64_t kMostStep = std::uint64_t(32) << 20;

std::uint64_t roundUp(std::uint64_t bytes, std::uint64_t unit) { return (bytes + unit - 1) / unit * unit; }

/// Driver functions, looked up through the runtime: the program must also start without a driver.
struct Driver {
  decltype(&cuDeviceGet) device = find<decltype(device)>("cuDeviceGet");
  decltype(&cuDeviceGetAttribute) attribute = find<decltype(attribute)>("cuDeviceGetAttribute");
  decltype(&cuMemGetAllocationGranularity) granularity = find<decltype(granularity)>("cuMemGetAllocationGranularity");
  decltype(&cuMemAddressReserve) reserve = find<decltype(reserve)>("cuMemAddressReserve");
  decltype(&cuMemAddressFree) unreserve = find<decltype(unreserve)>("cuMemAddressFree");
  decltype(&cuMemCreate) create = find<decltype(create)>("cuMemCreate");
  decltype(&cuMemRelease) release = find<decltype(release)>("cuMemRelease");
  decltype(&cuMemMap) map = find<decltype(map)>("cuMemMap");
  decltype(&cuMemUnmap) unmap = find<decltype(unmap)>("cuMemUnmap");
  decltype(&cuMemSetAccess) setAccess = find<decltype(setAccess)>("cuMemSetAccess");

  static const Driver& get() {
    static const Driver driver;
    return driver;
  }

 private:
  template <typename Function>
  static Function find(const char* name) {
    void* address = nullptr;
    cudaDriverEntryPointQueryResult found = cudaDriverEntryPointSymbolNotFound;
    ACCESSVDB_CUDA(cudaGetDriverEntryPointByVersion(name, &address, 12000, cudaEnableDefault, &found));
    if (found != cudaDriverEntryPointSuccess || address == nullptr) {
      throw DeviceError("device.old_driver", "cuda", std::string("the NVIDIA driver has no ") + name,
                        "Install a newer driver, or use BackendKind::Cpu");
    }
    return reinterpret_cast<Function>(address);
  }
};

void check(CUresult status, const char* call) {
  if (status == CUDA_SUCCESS) return;
  if (status == CUDA_ERROR_OUT_OF_MEMORY) throwDeviceMemory(std::string("no device memory left (") + call + ")");
  throw DeviceError("device.failed", "cuda", std::string(call) + " failed with code " + std::to_string(status),
                    "Check the GPU (nvidia-smi), or use BackendKind::Cpu");
}

CUmemAllocationProp propertiesOf(int device) {
  CUmemAllocationProp properties = {};
  properties.type = CU_MEM_ALLOCATION_TYPE_PINNED;
  properties.location.type = CU_MEM_LOCATION_TYPE_DEVICE;
  properties.location.id = device;
  return properties;
}

}  // namespace

AddressRange::AddressRange(std::shared_ptr<DeviceContext> context, std::uint64_t reserve_bytes)
    : context_(std::move(context)) {
  const CurrentDevice current(context_->device());
  ACCESSVDB_CUDA(cudaFree(nullptr));  // driver functions need the context, which the runtime creates lazily
  const Driver& driver = Driver::get();
  int can_map = 0;
  CUdevice device = 0;
  check(driver.device(&device, context_->device()), "cuDeviceGet");
  check(driver.attribute(&can_map, CU_DEVICE_ATTRIBUTE_VIRTUAL_MEMORY_MANAGEMENT_SUPPORTED, device),
        "cuDeviceGetAttribute");
  if (can_map == 0) {
    throw DeviceError("device.no_mapping", "cuda", context_->name() + " cannot map device memory by itself",
                      "Use another GPU, or BackendKind::Cpu");
  }
  const CUmemAllocationProp properties = propertiesOf(context_->device());
  std::size_t granularity = 0;
  check(driver.granularity(&granularity, &properties, CU_MEM_ALLOC_GRANULARITY_RECOMMENDED),
        "cuMemGetAllocationGranularity");
  granularity_ = granularity;
  const std::uint64_t least = roundUp(std::min(reserve_bytes, kLeastReserve), granularity_);
  for (std::uint64_t size = roundUp(reserve_bytes, granularity_);;
       size = std::max(least, roundUp(size / 2, granularity_))) {
    CUdeviceptr address = 0;
    const CUresult status = driver.reserve(&address, size, 0, 0, 0);
    if (status == CUDA_SUCCESS) {
      base_ = reinterpret_cast<void*>(address);
      reserved_ = size;
      return;
    }
    if (size <= least) check(status, "cuMemAddressReserve");
  }
}

AddressRange::~AddressRange() {
  const Driver& driver = Driver::get();  // already looked up, so this cannot throw
  for (const Piece& piece : pieces_) {
    (void)driver.unmap(reinterpret_cast<CUdeviceptr>(base_) + piece.offset, piece.bytes);
    (void)driver.release(piece.handle);
    context_->count(-static_cast<std::int64_t>(piece.bytes));
  }
  (void)driver.unreserve(reinterpret_cast<CUdeviceptr>(base_), reserved_);
}

void AddressRange::back(std::uint64_t bytes) {
  if (bytes <= backed_) return;
  if (bytes > reserved_) {
    throwDeviceMemory("more is needed than the " + std::to_string(reserved_ >> 20) +
                      " MiB of device addresses that were reserved");
  }
  const CurrentDevice current(context_->device());
  pieces_.reserve(pieces_.size() + 1);
  const std::uint64_t needed = roundUp(bytes, granularity_) - backed_;
  const std::uint64_t step = std::clamp(backed_ / 8, kLeastStep, kMostStep);
  const std::uint64_t wanted = std::min(std::max(needed, roundUp(step, granularity_)), reserved_ - backed_);
  try {
    mapMore(wanted);
  } catch (const ResourceLimit&) {
    // A whole step may not fit where the needed bytes still do.
    if (wanted == needed) throw;
    mapMore(needed);
  }
}

void AddressRange::mapMore(std::uint64_t bytes) {
  const Driver& driver = Driver::get();
  const CUmemAllocationProp properties = propertiesOf(context_->device());
  const CUdeviceptr address = reinterpret_cast<CUdeviceptr>(base_) + backed_;
  context_->count(static_cast<std::int64_t>(bytes));
  CUmemGenericAllocationHandle handle = 0;
  CUresult status = driver.create(&handle, bytes, &properties, 0);
  if (status == CUDA_SUCCESS) {
    status = driver.map(address, bytes, 0, handle, 0);
    if (status == CUDA_SUCCESS) {
      CUmemAccessDesc access = {};
      access.location = properties.location;
      access.flags = CU_MEM_ACCESS_FLAGS_PROT_READWRITE;
      status = driver.setAccess(address, bytes, &access, 1);
      if (status != CUDA_SUCCESS) (void)driver.unmap(address, bytes);
    }
    if (status != CUDA_SUCCESS) (void)driver.release(handle);
  }
  if (status != CUDA_SUCCESS) {
    context_->count(-static_cast<std::int64_t>(bytes));
    check(status, "mapping device memory");
  }
  pieces_.push_back({handle, backed_, bytes});
  backed_ += bytes;
}

}  // namespace accessvdb::kernels
