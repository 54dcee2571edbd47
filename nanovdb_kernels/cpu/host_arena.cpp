// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "cpu/host_arena.h"

#include <sys/mman.h>

#include <algorithm>
#include <cstring>
#include <string>

#include "accessvdb/error.h"

namespace accessvdb::kernels {
namespace {

constexpr std::uint64_t kHugePage = std::uint64_t(2) << 20;
// A step costs one system call, and no memory until it is touched.
constexpr std::uint64_t kLeastStep = std::uint64_t(64) << 20;
constexpr std::uint64_t kMostStep = std::uint64_t(1) << 30;

std::uint64_t roundUp(std::uint64_t bytes, std::uint64_t unit) { return (bytes + unit - 1) / unit * unit; }

std::string mebibytes(std::uint64_t bytes) { return std::to_string(roundUp(bytes, 1 << 20) >> 20) + " MiB"; }

}  // namespace

HostArena::HostArena(std::uint64_t reserve_bytes) {
  if (!(reserve_bytes > 0 && reserve_bytes <= std::uint64_t(1) << 46)) {
    throw InvalidArgument("arena.reserve_bytes", "", "The address range of a mirror must be 1 B to 64 TiB",
                          "Leave it at its default");
  }
  const std::uint64_t least = roundUp(std::min(reserve_bytes, kLeastReserveBytes), kHugePage);
  for (std::uint64_t size = roundUp(reserve_bytes, kHugePage);; size = std::max(least, roundUp(size / 2, kHugePage))) {
    mapping_bytes_ = size + kHugePage;
    mapping_ = mmap(nullptr, mapping_bytes_, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    if (mapping_ != MAP_FAILED) {
      reserved_ = size;
      break;
    }
    if (size <= least) {
      throw ResourceLimit("memory.mirror_addresses", "",
                          "Cannot reserve " + mebibytes(size) + " of addresses for the map that scoring reads",
                          "Raise the limit on virtual memory (ulimit -v)");
    }
  }
  const auto address = reinterpret_cast<std::uintptr_t>(mapping_);
  base_ = static_cast<unsigned char*>(mapping_) + (roundUp(address, kHugePage) - address);
  // Huge pages save TLB entries in scattered reads of millions of leaves. Only advice: kernels without it still work.
  (void)madvise(base_, reserved_, MADV_HUGEPAGE);
}

HostArena::~HostArena() { munmap(mapping_, mapping_bytes_); }

void HostArena::commit(std::uint64_t bytes) {
  if (bytes <= committed_) return;
  if (bytes > reserved_) {
    throw ResourceLimit("memory.mirror_reserve", "",
                        "The map that scoring reads needs " + mebibytes(bytes) + ", and only " + mebibytes(reserved_) +
                            " of addresses are reserved",
                        "Use larger voxels, or raise the limit on virtual memory (ulimit -v)");
  }
  const std::uint64_t step = std::clamp(roundUp(committed_ / 2, kHugePage), kLeastStep, kMostStep);
  const std::uint64_t wanted = std::min(std::max(roundUp(bytes, kHugePage), committed_ + step), reserved_);
  if (mprotect(base_ + committed_, wanted - committed_, PROT_READ | PROT_WRITE) == 0) {
    committed_ = wanted;
    return;
  }
  // The system may refuse the full step but grant what is needed.
  const std::uint64_t needed = roundUp(bytes, kHugePage);
  if (mprotect(base_ + committed_, needed - committed_, PROT_READ | PROT_WRITE) != 0) {
    throw ResourceLimit("memory.mirror", "",
                        "No memory left to grow the map that scoring reads to " + mebibytes(needed),
                        "Use larger voxels or free memory");
  }
  committed_ = needed;
}

void HostArena::write(std::uint64_t offset, const void* source, std::uint64_t bytes) {
  if (!(offset <= committed_ && bytes <= committed_ - offset)) throwOutside();
  std::memcpy(base_ + offset, source, bytes);
}

}  // namespace accessvdb::kernels
