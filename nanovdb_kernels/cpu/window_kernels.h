// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The inner loops on bit windows (map_window.h), compiled for several instruction sets; one set is selected at run
/// time. All give the same numbers.
#pragma once

#include <cstddef>
#include <cstdint>

namespace accessvdb::kernels {

/// Columns of the tool that are neighbours in y, one word of 64 voxels each.
struct WindowRun {
  std::int32_t offset = 0;  ///< of the first one from the point, in columns of the window
  std::uint32_t first = 0;  ///< index of its word
  std::uint32_t count = 0;
};

/// Four samples of a corridor, all at the height of the point, metres from it.
struct FlatSamples {
  static constexpr int kLanes = 4;
  float x[kLanes], y[kLanes];
};
/// Where a point's samples are looked up: a part of a window.
struct SampleWindow {
  const std::uint64_t* words;    ///< [x][y] at the point's height
  std::uint32_t stride;          ///< words from one x to the next
  unsigned bit;                  ///< of the point's height
  std::int32_t low_x, low_y;     ///< lowest voxel
  std::uint32_t size_x, size_y;  ///< [voxels]
  float x_m, y_m;                ///< the point
  float inverse_voxel_size;
};
/// One bit per sample.
struct SampleBits {
  unsigned inside, set;
};

struct WindowKernels {
  const char* name;
  /// Voxels that are set both in the tool and in the map, over [run, end). Stops once there are more than `stop_above`:
  /// the result is exact up to that value, otherwise some larger number.
  /// @param tool  words of the runs  @param map  word of the point's column  @param shift  bit of the map's words that
  ///   the tool's bit 0 lies on, 0 .. 63; no bit of the tool lies above the map's words
  int (*count)(const WindowRun* run, const WindowRun* end, const std::uint64_t* tool, const std::uint64_t* map,
               unsigned shift, int stop_above);
  /// The same for a map of several words per column. @param above  words that continue those of `map`
  int (*count_two)(const WindowRun* run, const WindowRun* end, const std::uint64_t* tool, const std::uint64_t* map,
                   const std::uint64_t* above, unsigned shift, int stop_above);
  /// Turns stacked leaves into 8 x 8 columns of one word each. A leaf has eight words [x], a byte per y, a bit per z.
  /// @param leaves  [count] from the lowest; null: no voxel is set  @param count  at most 8
  /// @param stride  words from one x to the next
  void (*stack)(const std::uint64_t* const* leaves, int count, std::uint64_t* columns, std::size_t stride);
  /// Looks up the voxels (voxelOf) of four samples.
  SampleBits (*look_up)(const SampleWindow& window, const FlatSamples& samples);
};

/// The best set for this machine.
const WindowKernels& windowKernels();
/// All sets that run on this machine, best first.
struct WindowKernelList {
  const WindowKernels* kernels[3];
  int count;
};
WindowKernelList runnableWindowKernels();

}  // namespace accessvdb::kernels
