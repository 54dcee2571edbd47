// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// Arrays that grow in nearly full memory.
#include <gtest/gtest.h>

#include <cstdlib>
#include <cstring>
#include <utility>

#include "accessvdb/error.h"
#include "launch/counted_memory.h"
#include "launch/device_array.h"

namespace accessvdb::test {
namespace {

/// Host memory with a given number of bytes.
class SmallMemory final : public kernels::DeviceMemory {
 public:
  explicit SmallMemory(std::size_t bytes) : free_(bytes) {}
  void* allocate(std::size_t bytes) override {
    if (bytes > free_) throw ResourceLimit("memory.device", "cuda", "full", "");
    free_ -= bytes;
    return std::malloc(bytes);
  }
  void release(void* address, std::size_t bytes) noexcept override {
    free_ += bytes;
    std::free(address);
  }
  void upload(void* to, const void* from, std::size_t bytes) override { std::memcpy(to, from, bytes); }
  void download(void* to, const void* from, std::size_t bytes) override { std::memcpy(to, from, bytes); }
  void copy(void* to, const void* from, std::size_t bytes) override { std::memcpy(to, from, bytes); }
  [[nodiscard]] std::size_t free() const { return free_; }

 private:
  std::size_t free_;
};

TEST(CountedMemory, CountsWhatItsArraysHold) {
  SmallMemory memory(1000);
  kernels::CountedMemory counted(memory);
  {
    kernels::DeviceArray<std::int32_t> a(counted, 10), b, none(counted, 0);
    EXPECT_EQ(counted.bytes(), 40u);
    b.growWithRoom(counted, 20, 30, 0);
    EXPECT_EQ(counted.bytes(), 160u);
    b.grow(counted, 40, 0);
    EXPECT_EQ(counted.bytes(), 200u);
    EXPECT_EQ(memory.free(), 800u);
    EXPECT_THROW(a.grow(counted, 1000, 10), ResourceLimit);
    EXPECT_EQ(counted.bytes(), 200u) << "what was refused is not counted";
    const kernels::DeviceArray<std::int32_t> moved = std::move(b);
    EXPECT_EQ(counted.bytes(), 200u);
  }
  EXPECT_EQ(counted.bytes(), 0u);
  EXPECT_EQ(memory.free(), 1000u);
}

TEST(DeviceArray, TakesTheRoomItWantsOrWhatWillDoOrNothing) {
  SmallMemory memory(1000);
  {
    kernels::DeviceArray<char> array;
    array.growWithRoom(memory, 100, 200, 0);
    EXPECT_EQ(array.size(), 200u);
    std::memset(array.data(), 7, 200);
    array.growWithRoom(memory, 150, 900, 200);
    EXPECT_EQ(array.size(), 200u) << "it is there";
    array.growWithRoom(memory, 700, 900, 200);  // 800 are free
    EXPECT_EQ(array.size(), 700u);
    EXPECT_EQ(array.data()[199], 7);
    EXPECT_THROW(array.growWithRoom(memory, 800, 900, 200), ResourceLimit);
    EXPECT_THROW(array.growWithRoom(memory, 800, 0, 200), ResourceLimit);
    EXPECT_EQ(array.size(), 700u) << "and stays as it was";
    EXPECT_EQ(array.data()[199], 7);
    EXPECT_EQ(memory.free(), 300u);
  }
  EXPECT_EQ(memory.free(), 1000u);
}

}  // namespace
}  // namespace accessvdb::test
