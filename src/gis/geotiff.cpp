// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "gis/geotiff.h"

#include "gis/memory_file.h"
#include "gis/spatial_reference.h"

namespace accessvdb::gis {

void writeGeoTiff(const Raster& raster, const SurveyFrame& frame, const std::string& software, std::ostream& out) {
  const Gdal& api = gdal();
  const MemoryFile file(".tif");
  const SpatialReference reference = referenceOf(frame);
  api.CPLErrorReset();
  char compress[] = "COMPRESS=DEFLATE", tiled[] = "TILED=YES", large[] = "BIGTIFF=IF_SAFER";
  char* options[] = {compress, tiled, large, nullptr};
  DataSet tiff(api.GDALCreate(api.GDALGetDriverByName("GTiff"), file.name(), raster.columns, raster.rows,
                              static_cast<int>(raster.bands.size()), GDT_Float32, options));
  if (tiff.get() == nullptr) failOf("make a GeoTIFF");
  double transform[] = {raster.west, raster.cell_x, 0, raster.north, 0, -raster.cell_y};
  if (api.GDALSetGeoTransform(tiff.get(), transform) != CE_None) failOf("place the raster");
  if (reference && api.GDALSetSpatialRef(tiff.get(), reference.get()) != CE_None) failOf("write the frame");
  api.GDALSetMetadataItem(tiff.get(), "TIFFTAG_SOFTWARE", software.c_str(), nullptr);
  for (std::size_t n = 0; n < raster.bands.size(); ++n) {
    const Raster::Band& of = raster.bands[n];
    const GDALRasterBandH band = api.GDALGetRasterBand(tiff.get(), static_cast<int>(n) + 1);
    api.GDALSetDescription(band, of.name.c_str());
    api.GDALSetRasterNoDataValue(band, static_cast<double>(Raster::kNone));
    std::vector<float> row(static_cast<std::size_t>(raster.columns));
    for (int y = 0; y < raster.rows; ++y) {
      const auto begin = of.values.begin() + static_cast<std::ptrdiff_t>(y) * raster.columns;
      row.assign(begin, begin + raster.columns);
      if (api.GDALRasterIO(band, GF_Write, 0, y, raster.columns, 1, row.data(), raster.columns, 1, GDT_Float32, 0, 0) !=
          CE_None) {
        failOf("write the raster");
      }
    }
  }
  if (!tiff.close()) failOf("write the raster");
  file.copyTo(out);
}

}  // namespace accessvdb::gis
