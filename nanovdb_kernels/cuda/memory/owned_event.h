// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// An owned CUDA event: nothing leaks when creating one of several events fails.
#pragma once

#include <cuda_runtime_api.h>

#include "cuda/memory/cuda_check.h"

namespace accessvdb::kernels {

class OwnedEvent {
 public:
  /// @param flags  as for cudaEventCreateWithFlags
  explicit OwnedEvent(unsigned flags) { ACCESSVDB_CUDA(cudaEventCreateWithFlags(&event_, flags)); }
  ~OwnedEvent() { (void)cudaEventDestroy(event_); }
  OwnedEvent(const OwnedEvent&) = delete;
  OwnedEvent& operator=(const OwnedEvent&) = delete;
  [[nodiscard]] cudaEvent_t get() const { return event_; }

 private:
  cudaEvent_t event_ = nullptr;
};

}  // namespace accessvdb::kernels
