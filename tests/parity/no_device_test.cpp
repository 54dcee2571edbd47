// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// A build with CUDA on a machine without a usable GPU: one clear line, code 6, or the CPU with a statement.
#include <gtest/gtest.h>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/error.h"

namespace accessvdb::test {
namespace {

AccessibilityField fieldOn(BackendKind backend) {
  FieldParams params;
  params.tsdf.voxel_size_m = 0.05;
  params.backend = backend;
  return AccessibilityField(ToolGeometry::builtin("builtin:pencil"), params);
}

TEST(NoDevice, CudaIsRefusedOrGiven) {
  try {
    EXPECT_EQ(fieldOn(BackendKind::Cuda).deviceName().rfind("cuda:", 0), 0u);
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.exitCode(), 6);
    EXPECT_EQ(error.id().rfind("device.", 0), 0u) << error.id();
    EXPECT_NE(error.advice().find("BackendKind::Cpu"), std::string::npos) << error.what();
    EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
  }
}

TEST(NoDevice, AutoSaysWhyItIsOnTheCpu) {
  const AccessibilityField field = fieldOn(BackendKind::Auto);
  EXPECT_EQ(field.deviceName() == "cpu", !field.deviceNote().empty()) << field.deviceName() << field.deviceNote();
}

TEST(NoDevice, CpuNeedsNoStatement) {
  const AccessibilityField field = fieldOn(BackendKind::Cpu);
  EXPECT_EQ(field.deviceName(), "cpu");
  EXPECT_EQ(field.deviceNote(), "");
  EXPECT_EQ(field.memoryUse().device_peak_bytes, 0u);
}

}  // namespace
}  // namespace accessvdb::test
