// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// GDAL's functions in C. Its library, with a hundred others behind it, is loaded when the first file is written: it
/// would double the time in which the program starts.
#pragma once

#include <gdal.h>
#include <ogr_api.h>
#include <ogr_srs_api.h>

#include <string>

namespace accessvdb::gis {

// Each as GDAL's headers declare it, by its name.
#define ACCESSVDB_GDAL_FUNCTIONS(USE) \
  USE(CPLErrorReset)                  \
  USE(CPLGetLastErrorMsg)             \
  USE(CPLGetLastErrorType)            \
  USE(CPLPushErrorHandler)            \
  USE(CPLQuietErrorHandler)           \
  USE(GDALAllRegister)                \
  USE(GDALClose)                      \
  USE(GDALCreate)                     \
  USE(GDALDatasetCommitTransaction)   \
  USE(GDALDatasetCreateLayer)         \
  USE(GDALDatasetStartTransaction)    \
  USE(GDALGetDriverByName)            \
  USE(GDALGetRasterBand)              \
  USE(GDALGetSpatialRef)              \
  USE(GDALOpenEx)                     \
  USE(GDALRasterIO)                   \
  USE(GDALSetDescription)             \
  USE(GDALSetGeoTransform)            \
  USE(GDALSetMetadataItem)            \
  USE(GDALSetRasterNoDataValue)       \
  USE(GDALSetSpatialRef)              \
  USE(OGR_F_Create)                   \
  USE(OGR_F_Destroy)                  \
  USE(OGR_F_SetFID)                   \
  USE(OGR_F_SetFieldDouble)           \
  USE(OGR_F_SetFieldInteger)          \
  USE(OGR_F_SetFieldNull)             \
  USE(OGR_F_SetFieldString)           \
  USE(OGR_F_SetGeometryDirectly)      \
  USE(OGR_Fld_Create)                 \
  USE(OGR_Fld_Destroy)                \
  USE(OGR_G_CreateGeometry)           \
  USE(OGR_G_SetPoint)                 \
  USE(OGR_L_CreateFeature)            \
  USE(OGR_L_CreateField)              \
  USE(OGR_L_GetLayerDefn)             \
  USE(OSRClone)                       \
  USE(OSRDestroySpatialReference)     \
  USE(OSRImportFromWkt)               \
  USE(OSRNewSpatialReference)         \
  USE(VSIFCloseL)                     \
  USE(VSIFileFromMemBuffer)           \
  USE(VSIGetMemFileBuffer)            \
  USE(VSIUnlink)

struct Gdal {
#define ACCESSVDB_GDAL_MEMBER(name) decltype(&::name) name;
  ACCESSVDB_GDAL_FUNCTIONS(ACCESSVDB_GDAL_MEMBER)
#undef ACCESSVDB_GDAL_MEMBER
};

/// Loads it the first time. GDAL prints nothing by itself from then on. @throws UnusableInput "gdal.missing"
[[nodiscard]] const Gdal& gdal();

/// @param what  could not be done  @throws OutputError "gdal.failed" with GDAL's own words
[[noreturn]] void failOf(const std::string& what);

}  // namespace accessvdb::gis
