// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which backend a field scores on.
#pragma once

#include <memory>
#include <string>
#include <utility>

#include "accessvdb/error.h"
#include "accessvdb/params.h"
#include "launch/backend.h"

namespace accessvdb::internal {

struct ChosenBackend {
  std::unique_ptr<kernels::Backend> backend;
  std::string note_id, note;  ///< why Auto is not on a GPU, as in an Error; else empty
};

/// Whether the GPU failed in any way: missing, lost, out of memory. Data on the host are still valid.
/// Errors of a backend have the subject "cuda".
[[nodiscard]] bool isOfDevice(const Error& error);

/// @throw DeviceError    Cuda, but there is no usable GPU or this build has no CUDA backend
/// @throw ResourceLimit  Cuda, but its memory does not suffice to start
[[nodiscard]] ChosenBackend cudaBackend();
[[nodiscard]] ChosenBackend cpuBackend();

/// Makes something on a backend. Cpu and Cuda are taken literally. Auto takes a GPU, or the CPU if no GPU is usable or
/// making fails on it: a card without room for the first tables is of no use either.
/// @param make  called with a ChosenBackend, at most twice
template <typename Make>
auto onBackend(const FieldParams& resolved, const Make& make) -> decltype(make(ChosenBackend{})) {
  if (resolved.backend == BackendKind::Cuda) return make(cudaBackend());
  ChosenBackend cpu = cpuBackend();
  if (resolved.backend == BackendKind::Auto) {
    try {
      return make(cudaBackend());
    } catch (const Error& error) {
      if (!isOfDevice(error)) throw;
      cpu.note_id = error.id();
      cpu.note = error.problem();
    }
  }
  return make(std::move(cpu));
}

}  // namespace accessvdb::internal
