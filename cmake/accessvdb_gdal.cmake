# Whether the program of this build writes GeoTIFF and GeoPackage: option ACCESSVDB_GDAL, result ACCESSVDB_HAS_GDAL. Only
# GDAL's headers are needed; its library is loaded when such a file is written (src/gis).
accessvdb_choice(ACCESSVDB_GDAL "export --raster and --vector, through GDAL" "GDAL's headers are found")

set(ACCESSVDB_HAS_GDAL OFF)
if(NOT ACCESSVDB_GDAL STREQUAL "OFF" AND (ACCESSVDB_BUILD_TOOLS OR ACCESSVDB_BUILD_TESTS))
  find_path(ACCESSVDB_GDAL_INCLUDE_DIR gdal.h PATH_SUFFIXES gdal)
  mark_as_advanced(ACCESSVDB_GDAL_INCLUDE_DIR)
  if(ACCESSVDB_GDAL_INCLUDE_DIR)
    set(ACCESSVDB_HAS_GDAL ON)
    message(STATUS "AccessVDB: rasters and vectors with GDAL")
  elseif(ACCESSVDB_GDAL STREQUAL "ON")
    message(FATAL_ERROR "ACCESSVDB_GDAL is ON, but gdal.h was not found. On Debian and Ubuntu: "
                        "apt install libgdal-dev, or use ACCESSVDB_GDAL=AUTO")
  elseif(PROJECT_IS_TOP_LEVEL)
    message(STATUS "AccessVDB: no GDAL; the program is built without export --raster and --vector")
  endif()
endif()
