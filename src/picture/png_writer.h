// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// An RGB picture in memory, and as a PNG file.
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "io/results/label_colours.h"

namespace accessvdb::internal {

struct RgbImage {
  int width_px = 0;
  int height_px = 0;
  std::vector<std::uint8_t> rgb;  ///< [height][width][3], top row first

  RgbImage(int width, int height, const Rgb& fill);
  /// Pixels outside the picture are ignored.
  void set(int x, int y, const Rgb& colour);
  /// Alpha 0 leaves the picture, 1 paints over it.
  void blend(int x, int y, const Rgb& colour, float alpha);
  void fillRectangle(int x0, int y0, int x1, int y1, const Rgb& colour, float alpha);
};

/// @throws OutputError
void writePng(const std::filesystem::path& path, const RgbImage& image);

}  // namespace accessvdb::internal
