// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The tool and the corridor in the form in which they are compared with bit windows of the map (map_window.h): for
/// each direction, runs of words that lie as the words of a window do.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "cpu/window_kernels.h"
#include "hostdev/views.h"
#include "launch/backend.h"

namespace accessvdb::kernels {

/// What the points of some inner leaves may read: a box of leaves around these. The same everywhere.
struct WindowBox {
  int xy_log2 = 0, z_log2 = 0;                   ///< edges of the inner leaves
  std::array<std::int32_t, 3> low = {};          ///< of the box, in leaves from the first inner leaf
  std::array<std::int32_t, 3> size = {1, 1, 1};  ///< in leaves
  /// Words per column of voxels; a window holds one more, which stays 0.
  [[nodiscard]] std::int32_t words() const { return (size[2] + 7) / 8; }
  [[nodiscard]] std::size_t stride() const { return static_cast<std::size_t>(size[1]) * 8; }
  [[nodiscard]] std::size_t columnsOfVoxels() const { return static_cast<std::size_t>(size[0]) * 8 * stride(); }
  [[nodiscard]] std::size_t columnsOfLeaves() const {
    return static_cast<std::size_t>(size[0]) * static_cast<std::size_t>(size[1]);
  }
  /// Memory of a thread's window.
  [[nodiscard]] std::uint64_t bytes() const {
    return 2 * columnsOfVoxels() * static_cast<std::uint64_t>(words() + 1) * sizeof(std::uint64_t);
  }
};

class WindowedTool final : public PreparedTool {
 public:
  /// Largest window of a thread; beyond that, the map is read row by row.
  static constexpr std::uint64_t kMostWindowBytes = std::uint64_t{16} << 20;

  /// Runs that share their words' height.
  struct Layer {
    std::int32_t dz = 0;  ///< of bit 0, from the point's voxel
    std::uint32_t begin = 0, end = 0;
  };

  /// @param tool, approach  in host memory
  WindowedTool(const ToolKernelView& tool, const ApproachView& approach, float inverse_voxel_size);

  /// Whether there is a window; otherwise nothing else may be called.
  [[nodiscard]] bool usable() const { return usable_; }
  [[nodiscard]] const WindowBox& shape() const { return shape_; }
  /// Of a part (ToolKernelView). Voxel form: empty with samples.
  [[nodiscard]] std::span<const Layer> layers(int part) const { return listOf(layers_, layer_begin_, part); }
  [[nodiscard]] const WindowRun* runs() const { return runs_.data(); }
  [[nodiscard]] const std::uint64_t* words() const { return words_.data(); }
  /// Columns of leaves that a part of the tool may touch, wherever in its leaf the point is: offsets in the window from
  /// the column of that leaf. Voxel form only.
  [[nodiscard]] std::span<const std::int32_t> leaves(int part) const { return listOf(leaves_, leaf_begin_, part); }
  /// Of all directions, in the voxel form.
  [[nodiscard]] int parts() const { return layer_begin_.empty() ? 0 : static_cast<int>(layer_begin_.size()) - 1; }
  /// The corridor of direction d. Empty unless all samples are at the height of the point.
  [[nodiscard]] std::span<const FlatSamples> corridor(int d) const {
    return std::span(corridors_).subspan(static_cast<std::size_t>(d) * corridor_length_, corridor_length_);
  }
  /// Columns of leaves of a window that corridors may touch.
  struct LeafBox {
    std::int32_t low_x = 0, low_y = 0, high_x = -1, high_y = -1;  ///< inclusive
  };
  [[nodiscard]] const LeafBox& corridorLeaves() const { return corridor_leaves_; }
  [[nodiscard]] std::uint64_t bytes() const override;

 private:
  struct Part;
  template <typename T>
  [[nodiscard]] static std::span<const T> listOf(const std::vector<T>& all, const std::vector<std::uint32_t>& begin,
                                                 int part) {
    const auto n = static_cast<std::size_t>(part);
    return std::span(all).subspan(begin[n], begin[n + 1] - begin[n]);
  }
  void makeCorridors(const ApproachView& approach, float inverse_voxel_size);
  void chooseShape(const ToolKernelView& tool, const ApproachView& approach, float inverse_voxel_size);
  [[nodiscard]] Part makePart(const ToolKernelView& tool, int part) const;

  bool usable_ = false;
  WindowBox shape_;
  std::vector<Layer> layers_;
  std::vector<WindowRun> runs_;
  std::vector<std::uint64_t> words_;
  std::vector<std::int32_t> leaves_;
  std::vector<std::uint32_t> layer_begin_, leaf_begin_;  ///< [parts + 1]
  std::vector<FlatSamples> corridors_;                   ///< [D x corridor_length_]
  std::size_t corridor_length_ = 0;
  LeafBox corridor_leaves_;
};

}  // namespace accessvdb::kernels
