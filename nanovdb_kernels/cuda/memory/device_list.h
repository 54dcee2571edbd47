// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A device list as it is passed to a kernel.
#pragma once

#include <cstdint>

namespace accessvdb::kernels {

template <typename T>
struct DeviceList {
  const T* data = nullptr;
  std::uint32_t count = 0;
};

}  // namespace accessvdb::kernels
