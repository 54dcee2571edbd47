# Every package that the library stands on, with the name of the Debian package where it is missing.
# TBB and PCL must be found before OpenVDB: its Find module otherwise defines a TBB target of its own.

find_package(TBB CONFIG QUIET)
if(NOT TBB_FOUND)
  message(FATAL_ERROR "AccessVDB needs oneTBB. On Debian and Ubuntu: apt install libtbb-dev")
endif()

set(CMAKE_DISABLE_FIND_PACKAGE_VTK ON)  # PCL's readers that we use do not need it, and it would join the link
find_package(PCL 1.12 QUIET COMPONENTS common io)
if(NOT PCL_FOUND)
  message(FATAL_ERROR "AccessVDB needs PCL (common, io). On Debian and Ubuntu: apt install libpcl-dev")
endif()

# Debian installs OpenVDB's Find module beside the libraries, outside CMake's own path.
file(GLOB _openvdb_modules /usr/lib/*/cmake/OpenVDB /usr/lib/cmake/OpenVDB /usr/local/lib*/cmake/OpenVDB)
list(APPEND CMAKE_MODULE_PATH ${_openvdb_modules})
find_package(OpenVDB QUIET COMPONENTS openvdb nanovdb)
if(NOT OpenVDB_FOUND)
  message(FATAL_ERROR "AccessVDB needs OpenVDB with NanoVDB. On Debian and Ubuntu: apt install libopenvdb-dev libnanovdb-dev")
endif()

foreach(_package IN ITEMS "Eigen3|libeigen3-dev" "assimp|libassimp-dev" "nlohmann_json|nlohmann-json3-dev" "PNG|libpng-dev"
                          "OpenSSL|libssl-dev")
  string(REPLACE "|" ";" _package ${_package})
  list(GET _package 0 _name)
  list(GET _package 1 _debian)
  find_package(${_name} QUIET)
  if(NOT ${_name}_FOUND)
    message(FATAL_ERROR "AccessVDB needs ${_name}. On Debian and Ubuntu: apt install ${_debian}")
  endif()
endforeach()
