# Every package that the library depends on, with the Debian package name in case it is missing.
# TBB and PCL must be found before OpenVDB: its Find module otherwise defines a TBB target of its own.

find_package(TBB CONFIG QUIET)
if(NOT TBB_FOUND)
  message(FATAL_ERROR "AccessVDB needs oneTBB. On Debian and Ubuntu: apt install libtbb-dev")
endif()

# PCL is only used by tests and an example; the library reads PCD files itself. Nothing installed depends on it except
# accessvdb/pcl.h, which is for users of PCL.
accessvdb_choice(ACCESSVDB_PCL "Tests and the example that use PCL" "PCL is found")
set(ACCESSVDB_HAS_PCL OFF)
if(NOT ACCESSVDB_PCL STREQUAL "OFF" AND PROJECT_IS_TOP_LEVEL AND (ACCESSVDB_BUILD_TESTS OR ACCESSVDB_BUILD_EXAMPLES))
  set(CMAKE_DISABLE_FIND_PACKAGE_VTK ON)  # the parts of PCL used here do not need it, and it would be linked
  find_package(PCL 1.12 QUIET COMPONENTS common io filters)
  set(ACCESSVDB_HAS_PCL ${PCL_FOUND})
endif()
if(ACCESSVDB_PCL STREQUAL "ON" AND NOT ACCESSVDB_HAS_PCL)
  message(FATAL_ERROR "ACCESSVDB_PCL is ON, but PCL (common, io, filters) was not found. On Debian and Ubuntu: "
                      "apt install libpcl-dev, or use ACCESSVDB_PCL=AUTO")
endif()
if(NOT ACCESSVDB_HAS_PCL AND PROJECT_IS_TOP_LEVEL)
  message(STATUS "AccessVDB: no PCL; its tests and its example are not built")
endif()

# OpenVDB installs its Find module next to the libraries, outside CMake's own path.
foreach(_prefix IN LISTS CMAKE_PREFIX_PATH ITEMS ${CMAKE_SYSROOT}/usr/local ${CMAKE_SYSROOT}/usr)  # in this order: GLOB sorts
  file(GLOB _openvdb_modules ${_prefix}/lib*/cmake/OpenVDB ${_prefix}/lib/*/cmake/OpenVDB)
  list(APPEND CMAKE_MODULE_PATH ${_openvdb_modules})
endforeach()
find_package(OpenVDB QUIET COMPONENTS openvdb nanovdb)
if(NOT OpenVDB_FOUND)
  message(FATAL_ERROR "AccessVDB needs OpenVDB with NanoVDB. On Debian and Ubuntu: apt install libopenvdb-dev libnanovdb-dev")
elseif(OpenVDB_VERSION VERSION_LESS 10.0 OR OpenVDB_VERSION VERSION_GREATER_EQUAL 14.0)
  message(FATAL_ERROR "AccessVDB needs OpenVDB 10 to 13; this is ${OpenVDB_VERSION}. Name another one: "
                      "-DCMAKE_PREFIX_PATH=PREFIX, with the prefix that it is installed in")
endif()
string(REGEX MATCH "^[0-9]+\\.[0-9]+" ACCESSVDB_OPENVDB_RELEASE ${OpenVDB_VERSION})
# The grids of a GPU are laid out by hand: src/mirror/grid_layout.h checks that as it is compiled, and says what differs.
find_path(ACCESSVDB_NANOVDB_INCLUDE_DIR nanovdb/NanoVDB.h REQUIRED)
file(STRINGS ${ACCESSVDB_NANOVDB_INCLUDE_DIR}/nanovdb/NanoVDB.h _nanovdb REGEX "^#define NANOVDB_(MAJOR|MINOR)_VERSION_NUMBER +[0-9]+")
list(TRANSFORM _nanovdb REPLACE "^#define [A-Z_]+ +([0-9]+).*" "\\1")
list(JOIN _nanovdb "." ACCESSVDB_NANOVDB_VERSION)
if(ACCESSVDB_NANOVDB_VERSION VERSION_LESS 32.4 OR ACCESSVDB_NANOVDB_VERSION VERSION_GREATER_EQUAL 33)
  message(FATAL_ERROR "AccessVDB needs NanoVDB 32.4 or a later 32.x, which come with OpenVDB 10 to 13; "
                      "${ACCESSVDB_NANOVDB_INCLUDE_DIR}/nanovdb is ${ACCESSVDB_NANOVDB_VERSION}. Name another one: "
                      "-DACCESSVDB_NANOVDB_INCLUDE_DIR=FOLDER, with the folder that has nanovdb/NanoVDB.h")
elseif(PROJECT_IS_TOP_LEVEL)
  message(STATUS "AccessVDB: OpenVDB ${OpenVDB_VERSION}, NanoVDB ${ACCESSVDB_NANOVDB_VERSION}")
  if(ACCESSVDB_NANOVDB_VERSION VERSION_GREATER 32.9)
    message(WARNING "AccessVDB: nobody has tried NanoVDB ${ACCESSVDB_NANOVDB_VERSION} yet, only 32.4 to 32.9. Run ctest -L parity")
  endif()
endif()

foreach(_package IN ITEMS "Eigen3|libeigen3-dev" "assimp|libassimp-dev" "nlohmann_json|nlohmann-json3-dev" "PNG|libpng-dev"
                          "ZLIB|zlib1g-dev" "OpenSSL|libssl-dev")
  string(REPLACE "|" ";" _package ${_package})
  list(GET _package 0 _name)
  list(GET _package 1 _debian)
  find_package(${_name} QUIET)
  if(NOT ${_name}_FOUND)
    message(FATAL_ERROR "AccessVDB needs ${_name}. On Debian and Ubuntu: apt install ${_debian}")
  endif()
endforeach()

# LZF, for compressed PCD files.
find_path(ACCESSVDB_LZF_INCLUDE_DIR lzf.h PATH_SUFFIXES liblzf)
find_library(ACCESSVDB_LZF_LIBRARY NAMES lzf)
mark_as_advanced(ACCESSVDB_LZF_INCLUDE_DIR ACCESSVDB_LZF_LIBRARY)
if(NOT ACCESSVDB_LZF_INCLUDE_DIR OR NOT ACCESSVDB_LZF_LIBRARY)
  message(FATAL_ERROR "AccessVDB needs liblzf. On Debian and Ubuntu: apt install liblzf-dev")
endif()

# Recordings: compressed chunks and their checksums, and rosbag2's databases. Of zstd and LZ4 some distributions have
# CMake packages, some pkg-config files; all have the library.
set(ACCESSVDB_RECORDING_LIBRARIES "")
foreach(_package IN ITEMS "BZ2|bzlib.h|bz2|libbz2-dev" "LZ4|lz4frame.h|lz4|liblz4-dev" "SQLITE3|sqlite3.h|sqlite3|libsqlite3-dev"
                          "ZLIB|zlib.h|z|zlib1g-dev" "ZSTD|zstd.h|zstd|libzstd-dev")
  string(REPLACE "|" ";" _package ${_package})
  list(POP_FRONT _package _name _header _library _debian)
  find_path(ACCESSVDB_${_name}_INCLUDE_DIR ${_header})
  find_library(ACCESSVDB_${_name}_LIBRARY NAMES ${_library})
  mark_as_advanced(ACCESSVDB_${_name}_INCLUDE_DIR ACCESSVDB_${_name}_LIBRARY)
  if(NOT ACCESSVDB_${_name}_INCLUDE_DIR OR NOT ACCESSVDB_${_name}_LIBRARY)
    message(FATAL_ERROR "AccessVDB needs ${_library}. On Debian and Ubuntu: apt install ${_debian}")
  endif()
  list(APPEND ACCESSVDB_RECORDING_LIBRARIES ${ACCESSVDB_${_name}_LIBRARY})
endforeach()

# OpenVDB's usual trees are compiled in libopenvdb.so: registering them for files instantiates them there. Files that
# declare them with `extern template` (src/vdb) compile in less than half the time. Verified for OpenVDB 10.0, which
# Debian 12 and Ubuntu 24.04 have; if the symbols are not found, everything is compiled as usual.
if(OpenVDB_VERSION VERSION_GREATER_EQUAL 10.0 AND OpenVDB_VERSION VERSION_LESS 10.1)
  include(CheckCSourceCompiles)
  set(CMAKE_REQUIRED_LIBRARIES ${OpenVDB_openvdb_LIBRARY})
  check_c_source_compiles([[
extern const char float_tree __asm__("_ZTVN7openvdb5v10_04tree4TreeINS1_8RootNodeINS1_12InternalNodeINS4_INS1_8LeafNodeIfLj3EEELj4EEELj5EEEEEEE");
extern const char point_grid __asm__("_ZTVN7openvdb5v10_04GridINS0_4tree4TreeINS2_8RootNodeINS2_12InternalNodeINS5_INS0_6points17PointDataLeafNodeINS0_10PointIndexIjLj1EEELj3EEELj4EEELj5EEEEEEEEE");
int main(void) { return float_tree == 1 && point_grid == 1; }
]] ACCESSVDB_GRIDS_IN_LIBOPENVDB)
  unset(CMAKE_REQUIRED_LIBRARIES)
endif()
