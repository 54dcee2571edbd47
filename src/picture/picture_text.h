// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Text in pictures from a built-in 5 x 7 font: no font file, no display.
#pragma once

#include <string>

#include "picture/png_writer.h"

namespace accessvdb::internal {

/// Pixels per font step for a picture of this height.
[[nodiscard]] int textScale(int picture_height_px);
[[nodiscard]] int textWidth(const std::string& text, int scale);
[[nodiscard]] constexpr int textHeight(int scale) { return 7 * scale; }
/// Top left corner at x, y. Characters without a glyph are left blank.
void drawText(RgbImage& image, int x, int y, const std::string& text, int scale, const Rgb& colour);

/// "1 234 567": groups of three, readable at a glance.
[[nodiscard]] std::string groupedText(std::uint64_t number);
/// Digits after the point, whatever the locale.
[[nodiscard]] std::string fixedText(double number, int digits);

}  // namespace accessvdb::internal
