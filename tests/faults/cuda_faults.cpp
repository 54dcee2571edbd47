// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "faults/cuda_faults.h"

#include <cuda.h>

#include <cstdlib>
#include <cstring>
#include <mutex>

namespace accessvdb::test {
namespace {

/// One per process; the environment can set it for programs: ACCESSVDB_TEST_FAULT="NTH CODE CALL|any [lost]".
struct State {
  std::mutex mutex;
  CudaFault fault;
  std::uint64_t calls = 0, named = 0;
  bool met = false;
  std::string met_at;
  CudaObjects objects;

  State() {
    const char* told = std::getenv("ACCESSVDB_TEST_FAULT");
    if (told == nullptr) return;
    char call[128] = "", lost[8] = "";
    unsigned long long nth = 0;
    int code = 0;
    if (std::sscanf(told, "%llu %d %127s %7s", &nth, &code, call, lost) < 3) std::abort();
    fault = {static_cast<cudaError_t>(code), nth, std::strcmp(call, "any") == 0 ? "" : call,
             std::strcmp(lost, "lost") == 0};
  }
};

State& state() {
  static State state;
  return state;
}

/// Error of the thread's last launch, until queried.
thread_local cudaError_t launch_error = cudaSuccess;

/// @return the error that the call must return; cudaSuccess = it proceeds
cudaError_t meet(const char* call) {
  State& s = state();
  const std::lock_guard lock(s.mutex);
  ++s.calls;
  if (s.met) return s.fault.lost ? s.fault.error : cudaSuccess;
  if (s.fault.error == cudaSuccess || (!s.fault.call.empty() && s.fault.call != call)) return cudaSuccess;
  if (++s.named != s.fault.nth) return cudaSuccess;
  s.met = true;
  s.met_at = call;
  return s.fault.error;
}

void countObject(std::int64_t CudaObjects::*kind, std::int64_t by) {
  State& s = state();
  const std::lock_guard lock(s.mutex);
  s.objects.*kind += by;
}

}  // namespace

void setFault(const CudaFault& fault) {
  State& s = state();
  const std::lock_guard lock(s.mutex);
  s.fault = fault;
  s.calls = s.named = 0;
  s.met = false;
  s.met_at.clear();
  launch_error = cudaSuccess;
}
bool faultMet() { return state().met; }
std::string faultyCall() { return state().met_at; }
std::uint64_t callsMade() { return state().calls; }
CudaObjects cudaObjects() { return state().objects; }
std::string inWords(const CudaObjects& o) {
  return std::to_string(o.memory) + " pieces of device memory, " + std::to_string(o.pinned) + " of pinned memory, " +
         std::to_string(o.streams) + " streams, " + std::to_string(o.events) + " events, " + std::to_string(o.ranges) +
         " address ranges, " + std::to_string(o.mapped) + " mapped pieces";
}

}  // namespace accessvdb::test

using accessvdb::test::countObject;
using accessvdb::test::CudaObjects;
using accessvdb::test::launch_error;
using accessvdb::test::meet;
using accessvdb::test::state;

// The names are the linker's: a call of cudaX arrives at __wrap_cudaX, and __real_cudaX is the runtime's.
// NOLINTBEGIN(bugprone-reserved-identifier)

#define PASS(name, parameters, arguments)                          \
  extern "C" cudaError_t __real_##name parameters;                 \
  extern "C" cudaError_t __wrap_##name parameters {                \
    const cudaError_t fault = meet(#name);                         \
    return fault != cudaSuccess ? fault : __real_##name arguments; \
  }
#define MAKE(kind, name, parameters, arguments)                    \
  extern "C" cudaError_t __real_##name parameters;                 \
  extern "C" cudaError_t __wrap_##name parameters {                \
    const cudaError_t fault = meet(#name);                         \
    if (fault != cudaSuccess) return fault;                        \
    const cudaError_t status = __real_##name arguments;            \
    if (status == cudaSuccess) countObject(&CudaObjects::kind, 1); \
    return status;                                                 \
  }
// Frees really free, whatever error the caller gets.
#define GIVE_BACK(kind, name, type)                                                      \
  extern "C" cudaError_t __real_##name(type);                                            \
  extern "C" cudaError_t __wrap_##name(type object) {                                    \
    const cudaError_t fault = meet(#name);                                               \
    const cudaError_t status = __real_##name(object);                                    \
    if (object != nullptr && status == cudaSuccess) countObject(&CudaObjects::kind, -1); \
    return fault != cudaSuccess ? fault : status;                                        \
  }

PASS(cudaDriverGetVersion, (int* version), (version))
PASS(cudaRuntimeGetVersion, (int* version), (version))
PASS(cudaGetDeviceCount, (int* count), (count))
PASS(cudaGetDevice, (int* device), (device))
PASS(cudaSetDevice, (int device), (device))
PASS(cudaGetDeviceProperties, (cudaDeviceProp * properties, int device), (properties, device))
PASS(cudaDeviceGetAttribute, (int* value, cudaDeviceAttr attribute, int device), (value, attribute, device))
PASS(cudaDeviceSynchronize, (), ())
PASS(cudaFuncGetAttributes, (cudaFuncAttributes * attributes, const void* kernel), (attributes, kernel))
PASS(cudaFuncSetAttribute, (const void* kernel, cudaFuncAttribute attribute, int value), (kernel, attribute, value))
PASS(cudaEventRecord, (cudaEvent_t event, cudaStream_t stream), (event, stream))
PASS(cudaEventSynchronize, (cudaEvent_t event), (event))
PASS(cudaStreamSynchronize, (cudaStream_t stream), (stream))
PASS(cudaStreamWaitEvent, (cudaStream_t stream, cudaEvent_t event, unsigned flags), (stream, event, flags))
PASS(cudaMemcpyAsync, (void* to, const void* from, std::size_t bytes, cudaMemcpyKind kind, cudaStream_t stream),
     (to, from, bytes, kind, stream))
PASS(cudaMemsetAsync, (void* to, int value, std::size_t bytes, cudaStream_t stream), (to, value, bytes, stream))
MAKE(memory, cudaMalloc, (void** address, std::size_t bytes), (address, bytes))
MAKE(pinned, cudaHostAlloc, (void** address, std::size_t bytes, unsigned flags), (address, bytes, flags))
MAKE(streams, cudaStreamCreateWithFlags, (cudaStream_t * stream, unsigned flags), (stream, flags))
MAKE(streams, cudaStreamCreateWithPriority, (cudaStream_t * stream, unsigned flags, int priority),
     (stream, flags, priority))
PASS(cudaDeviceGetStreamPriorityRange, (int* least, int* greatest), (least, greatest))
MAKE(events, cudaEventCreate, (cudaEvent_t * event), (event))
MAKE(events, cudaEventCreateWithFlags, (cudaEvent_t * event, unsigned flags), (event, flags))
GIVE_BACK(memory, cudaFree, void*)
GIVE_BACK(pinned, cudaFreeHost, void*)
GIVE_BACK(streams, cudaStreamDestroy, cudaStream_t)
GIVE_BACK(events, cudaEventDestroy, cudaEvent_t)

// A launch itself does not report errors: the next query does.
extern "C" cudaError_t __real___cudaLaunchKernel(cudaKernel_t, dim3, dim3, void**, std::size_t, cudaStream_t);
extern "C" cudaError_t __wrap___cudaLaunchKernel(cudaKernel_t kernel, dim3 grid, dim3 block, void** arguments,
                                                 std::size_t shared, cudaStream_t stream) {
  const cudaError_t fault = meet("launch");
  if (fault == cudaSuccess) return __real___cudaLaunchKernel(kernel, grid, block, arguments, shared, stream);
  launch_error = fault;
  return fault;
}
extern "C" cudaError_t __real_cudaGetLastError();
extern "C" cudaError_t __wrap_cudaGetLastError() {
  const cudaError_t before = launch_error, status = __real_cudaGetLastError();
  launch_error = cudaSuccess;
  return before != cudaSuccess ? before : status;
}
extern "C" cudaError_t __real_cudaPeekAtLastError();
extern "C" cudaError_t __wrap_cudaPeekAtLastError() {
  const cudaError_t before = launch_error;
  return before != cudaSuccess ? before : __real_cudaPeekAtLastError();
}

// Driver functions that are looked up by name.
namespace {

CUresult driverFault(const char* call) {
  const cudaError_t fault = meet(call);
  if (fault == cudaSuccess) return CUDA_SUCCESS;
  return fault == cudaErrorMemoryAllocation ? CUDA_ERROR_OUT_OF_MEMORY : CUDA_ERROR_UNKNOWN;
}

decltype(&cuMemAddressReserve) real_reserve = nullptr;
decltype(&cuMemAddressFree) real_unreserve = nullptr;
decltype(&cuMemCreate) real_create = nullptr;
decltype(&cuMemRelease) real_release = nullptr;
decltype(&cuMemMap) real_map = nullptr;
decltype(&cuMemSetAccess) real_access = nullptr;

CUresult CUDAAPI reserve(CUdeviceptr* address, std::size_t bytes, std::size_t alignment, CUdeviceptr hint,
                         unsigned long long flags) {
  CUresult status = driverFault("cuMemAddressReserve");
  if (status == CUDA_SUCCESS) status = real_reserve(address, bytes, alignment, hint, flags);
  if (status == CUDA_SUCCESS) countObject(&CudaObjects::ranges, 1);
  return status;
}
CUresult CUDAAPI unreserve(CUdeviceptr address, std::size_t bytes) {
  const CUresult fault = driverFault("cuMemAddressFree"), status = real_unreserve(address, bytes);
  if (status == CUDA_SUCCESS) countObject(&CudaObjects::ranges, -1);
  return fault != CUDA_SUCCESS ? fault : status;
}
CUresult CUDAAPI create(CUmemGenericAllocationHandle* handle, std::size_t bytes, const CUmemAllocationProp* properties,
                        unsigned long long flags) {
  CUresult status = driverFault("cuMemCreate");
  if (status == CUDA_SUCCESS) status = real_create(handle, bytes, properties, flags);
  if (status == CUDA_SUCCESS) countObject(&CudaObjects::mapped, 1);
  return status;
}
CUresult CUDAAPI releaseHandle(CUmemGenericAllocationHandle handle) {
  const CUresult fault = driverFault("cuMemRelease"), status = real_release(handle);
  if (status == CUDA_SUCCESS) countObject(&CudaObjects::mapped, -1);
  return fault != CUDA_SUCCESS ? fault : status;
}
CUresult CUDAAPI mapHandle(CUdeviceptr address, std::size_t bytes, std::size_t offset,
                           CUmemGenericAllocationHandle handle, unsigned long long flags) {
  const CUresult fault = driverFault("cuMemMap");
  return fault != CUDA_SUCCESS ? fault : real_map(address, bytes, offset, handle, flags);
}
CUresult CUDAAPI setAccess(CUdeviceptr address, std::size_t bytes, const CUmemAccessDesc* access, std::size_t count) {
  const CUresult fault = driverFault("cuMemSetAccess");
  return fault != CUDA_SUCCESS ? fault : real_access(address, bytes, access, count);
}

template <typename Function>
bool replace(const char* symbol, const char* name, void** address, Function& real, Function ours) {
  if (std::strcmp(symbol, name) != 0) return false;
  real = reinterpret_cast<Function>(*address);
  *address = reinterpret_cast<void*>(ours);
  return true;
}

}  // namespace

extern "C" cudaError_t __real_cudaGetDriverEntryPointByVersion(const char*, void**, unsigned, unsigned long long,
                                                               cudaDriverEntryPointQueryResult*);
extern "C" cudaError_t __wrap_cudaGetDriverEntryPointByVersion(const char* symbol, void** address, unsigned version,
                                                               unsigned long long flags,
                                                               cudaDriverEntryPointQueryResult* found) {
  const cudaError_t fault = meet("cudaGetDriverEntryPointByVersion");
  if (fault != cudaSuccess) return fault;
  const cudaError_t status = __real_cudaGetDriverEntryPointByVersion(symbol, address, version, flags, found);
  if (status != cudaSuccess || *address == nullptr) return status;
  (void)(replace(symbol, "cuMemAddressReserve", address, real_reserve, &reserve) ||
         replace(symbol, "cuMemAddressFree", address, real_unreserve, &unreserve) ||
         replace(symbol, "cuMemCreate", address, real_create, &create) ||
         replace(symbol, "cuMemRelease", address, real_release, &releaseHandle) ||
         replace(symbol, "cuMemMap", address, real_map, &mapHandle) ||
         replace(symbol, "cuMemSetAccess", address, real_access, &setAccess));
  return status;
}
// NOLINTEND(bugprone-reserved-identifier)
