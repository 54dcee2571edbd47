// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Base of every GPU test: without a GPU it is skipped with a reason, or fails if one is required.
#pragma once

#include <gtest/gtest.h>

#include <cstdlib>
#include <memory>
#include <string>

#include "accessvdb/error.h"
#include "cuda/cuda_backend.h"

namespace accessvdb::test {

/// Why no GPU can be used; empty if one can.
inline const std::string& whyNoGpu() {
  static const std::string why = [] {
    try {
      (void)kernels::makeCudaBackend();
    } catch (const DeviceError& error) {
      return error.problem();
    }
    return std::string();
  }();
  return why;
}

/// With ACCESSVDB_REQUIRE_GPU set, a machine without a GPU is a failure.
class GpuTest : public ::testing::Test {
 protected:
  void SetUp() override {
    if (whyNoGpu().empty()) return;
    if (std::getenv("ACCESSVDB_REQUIRE_GPU") != nullptr) FAIL() << "a GPU is required: " << whyNoGpu();
    GTEST_SKIP() << whyNoGpu();
  }
};

}  // namespace accessvdb::test
