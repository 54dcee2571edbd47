// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "picture/png_writer.h"

#include <png.h>

#include <algorithm>
#include <cmath>
#include <ostream>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"

namespace accessvdb::internal {

RgbImage::RgbImage(int width, int height, const Rgb& fill) : width_px(width), height_px(height) {
  rgb.resize(static_cast<std::size_t>(width) * static_cast<std::size_t>(height) * 3);
  for (std::size_t i = 0; i < rgb.size(); ++i) rgb[i] = fill[i % 3];
}

void RgbImage::set(int x, int y, const Rgb& colour) { blend(x, y, colour, 1.0f); }

void RgbImage::blend(int x, int y, const Rgb& colour, float alpha) {
  if (x < 0 || y < 0 || x >= width_px || y >= height_px) return;
  std::uint8_t* pixel =
      rgb.data() + (static_cast<std::size_t>(y) * static_cast<std::size_t>(width_px) + static_cast<std::size_t>(x)) * 3;
  for (std::size_t c = 0; c < 3; ++c) {
    const float mixed = static_cast<float>(pixel[c]) * (1 - alpha) + static_cast<float>(colour[c]) * alpha;
    pixel[c] = static_cast<std::uint8_t>(std::lround(std::clamp(mixed, 0.0f, 255.0f)));
  }
}

void RgbImage::fillRectangle(int x0, int y0, int x1, int y1, const Rgb& colour, float alpha) {
  for (int y = std::max(y0, 0); y < std::min(y1, height_px); ++y) {
    for (int x = std::max(x0, 0); x < std::min(x1, width_px); ++x) blend(x, y, colour, alpha);
  }
}

namespace {

/// Who made it, as PNG has it: a tEXt chunk.
void nameWriter(std::vector<std::uint8_t>& png) {
  constexpr char kText[] = "tEXtSoftware\0AccessVDB";  // without the final 0
  constexpr std::size_t kBytes = sizeof kText - 1;
  const auto put = [](std::vector<std::uint8_t>& to, std::uint32_t value) {
    for (int shift = 24; shift >= 0; shift -= 8) to.push_back(static_cast<std::uint8_t>(value >> shift));
  };
  std::vector<std::uint8_t> chunk;
  put(chunk, kBytes - 4);
  std::uint32_t crc = ~std::uint32_t{0};
  for (std::size_t n = 0; n < kBytes; ++n) {
    const auto byte = static_cast<std::uint8_t>(kText[n]);
    chunk.push_back(byte);
    crc ^= byte;
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ ((crc & 1) != 0 ? 0xedb88320u : 0u);
  }
  put(chunk, ~crc);
  constexpr std::ptrdiff_t kHeader = 8 + 25;  // signature and IHDR: so that it is found without reading the picture
  png.insert(png.begin() + kHeader, chunk.begin(), chunk.end());
}

}  // namespace

void writePng(const std::filesystem::path& path, const RgbImage& image) {
  png_image png = {};
  png.version = PNG_IMAGE_VERSION;
  png.width = static_cast<png_uint_32>(image.width_px);
  png.height = static_cast<png_uint_32>(image.height_px);
  png.format = PNG_FORMAT_RGB;
  // Encodes in memory, so that libpng never touches the file and we can check every write.
  std::vector<std::uint8_t> encoded(PNG_IMAGE_PNG_SIZE_MAX(png));
  png_alloc_size_t size = encoded.size();
  if (!png_image_write_to_memory(&png, encoded.data(), &size, 0, image.rgb.data(), 0, nullptr)) {
    const std::string why = png.message;
    png_image_free(&png);
    throw OutputError("output.png", path.string(), "the picture cannot be encoded (" + why + ")",
                      "Use a smaller picture");
  }
  encoded.resize(size);
  nameWriter(encoded);
  io::writeFileDurably(path, [&](std::ostream& stream) {
    stream.write(reinterpret_cast<const char*>(encoded.data()), static_cast<std::streamsize>(encoded.size()));
  });
}

}  // namespace accessvdb::internal
