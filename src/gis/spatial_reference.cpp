// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "gis/spatial_reference.h"

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "gis/memory_file.h"

namespace accessvdb::gis {
namespace {

void put(std::string& to, std::uint64_t value, int bytes) {
  for (int n = 0; n < bytes; ++n) to += static_cast<char>(value >> (8 * n) & 255);
}

/// A picture of one pixel with these GeoKeys: they are the same records in GeoTIFF and LAS, and only as the former does
/// GDAL read them. Source: TIFF 6.0, "Image file directory"; OGC GeoTIFF 1.1, 6.2 and 7.
std::string pixelWithKeys(const SurveyFrame& frame) {
  constexpr std::uint64_t kShort = 3, kLong = 4, kDouble = 12, kAscii = 2;
  struct Tag {
    std::uint64_t number, type, count;
    std::string bytes;
  };
  const auto number = [](std::uint64_t tag, std::uint64_t type, std::uint64_t value) {
    std::string bytes;
    put(bytes, value, type == kShort ? 2 : 4);
    return Tag{tag, type, 1, bytes};
  };
  const auto doubles = [](std::uint64_t tag, const std::vector<double>& values) {
    std::string bytes(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(double));
    return Tag{tag, kDouble, values.size(), std::move(bytes)};
  };
  constexpr std::uint64_t kPixelAt = 8, kDirectoryAt = 10;
  std::vector<Tag> tags = {number(256, kShort, 1),
                           number(257, kShort, 1),
                           number(258, kShort, 8),
                           number(259, kShort, 1),
                           number(262, kShort, 1),
                           number(273, kLong, kPixelAt),
                           number(277, kShort, 1),
                           number(278, kShort, 1),
                           number(279, kLong, 1),
                           doubles(33550, {1, 1, 0}),
                           doubles(33922, {0, 0, 0, 0, 0, 0}),
                           {34735, kShort, frame.geo_keys.size() / 2, frame.geo_keys}};
  if (!frame.geo_doubles.empty()) tags.push_back({34736, kDouble, frame.geo_doubles.size() / 8, frame.geo_doubles});
  if (!frame.geo_texts.empty()) tags.push_back({34737, kAscii, frame.geo_texts.size(), frame.geo_texts});
  std::string file("II*\0", 4), behind;
  put(file, kDirectoryAt, 4);
  put(file, 0, 2);  // the pixel, and a byte so that the directory begins at an even place
  put(file, tags.size(), 2);
  const std::uint64_t after = kDirectoryAt + 2 + 12 * tags.size() + 4;
  for (const Tag& tag : tags) {
    put(file, tag.number, 2);
    put(file, tag.type, 2);
    put(file, tag.count, 4);
    if (tag.bytes.size() <= 4) {
      file += tag.bytes;
      file.append(4 - tag.bytes.size(), '\0');
    } else {
      put(file, after + behind.size(), 4);
      behind += tag.bytes;
      if (behind.size() % 2 != 0) behind += '\0';
    }
  }
  put(file, 0, 4);
  return file + behind;
}

SpatialReference ofKeys(const SurveyFrame& frame) {
  const MemoryFile file("_keys.tif");
  std::string bytes = pixelWithKeys(frame);
  auto* const content = reinterpret_cast<GByte*>(bytes.data());
  if (VSILFILE* opened = gdal().VSIFileFromMemBuffer(file.name(), content, bytes.size(), FALSE)) {
    gdal().VSIFCloseL(opened);
  }
  const DataSet pixel(gdal().GDALOpenEx(file.name(), GDAL_OF_RASTER, nullptr, nullptr, nullptr));
  if (pixel.get() == nullptr) return nullptr;
  const OGRSpatialReferenceH found = gdal().GDALGetSpatialRef(pixel.get());
  return SpatialReference(found == nullptr ? nullptr : gdal().OSRClone(found));
}

}  // namespace

SpatialReference referenceOf(const SurveyFrame& frame) {
  if (!frame.hasSystem()) return nullptr;
  gdal().CPLErrorReset();
  SpatialReference reference;
  if (!frame.wkt.empty() && (frame.wkt_counts || frame.geo_keys.empty())) {
    reference.reset(gdal().OSRNewSpatialReference(nullptr));
    std::string wkt = frame.wkt;
    char* at = wkt.data();
    if (gdal().OSRImportFromWkt(reference.get(), &at) != OGRERR_NONE) failOf("read the well-known text of the frame");
  } else {
    reference = ofKeys(frame);
    if (!reference) failOf("read the GeoKeys of the frame");
  }
  return reference;
}

}  // namespace accessvdb::gis
