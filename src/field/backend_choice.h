// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which backend a field scores on.
#pragma once

#include <memory>
#include <string>

#include "accessvdb/params.h"
#include "launch/backend.h"

namespace accessvdb::internal {

struct ChosenBackend {
  std::unique_ptr<kernels::Backend> backend;
  std::string note;  ///< why Auto is not on a GPU; else empty
};

/// Cpu and Cuda are taken at their word; Auto takes a GPU where one can be used.
/// @throw DeviceError  Cuda, and there is no GPU to use or this build has no CUDA backend
[[nodiscard]] ChosenBackend chooseBackend(BackendKind kind);

}  // namespace accessvdb::internal
