# The install tree: headers, both kinds of library, the programs, the CMake package and the pkg-config file. It contains
# no absolute paths, so it can be moved.
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

# The component development is only needed to build other programs; cmake/accessvdb_packaging.cmake splits by it.
install(DIRECTORY ${PROJECT_SOURCE_DIR}/include/accessvdb DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}
        COMPONENT development FILES_MATCHING PATTERN "*.h")
install(FILES ${PROJECT_BINARY_DIR}/include/accessvdb/config.h DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/accessvdb
        COMPONENT development)

get_property(_device_headers GLOBAL PROPERTY ACCESSVDB_DEVICE_HEADERS)
install(FILES ${_device_headers} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/accessvdb/device COMPONENT development)

set(_package ${CMAKE_INSTALL_LIBDIR}/cmake/AccessVDB)
set(ACCESSVDB_DEFAULT_KIND static)
if(ACCESSVDB_SHARED)
  set(ACCESSVDB_DEFAULT_KIND shared)
endif()
set(ACCESSVDB_KINDS ${ACCESSVDB_DEFAULT_KIND})
if(ACCESSVDB_BOTH_KINDS)
  set(ACCESSVDB_KINDS static shared)
endif()

# One export per kind, each with the header-only target that it depends on; a consumer loads one of them.
foreach(_kind IN LISTS ACCESSVDB_KINDS)
  set(_library accessvdb)
  set(_export AccessVDBStaticTargets)
  if(_kind STREQUAL shared)
    set(_library accessvdb_shared)
    set(_export AccessVDBSharedTargets)
  endif()
  install(TARGETS ${_library} accessvdb_api EXPORT ${_export}
    ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT development
    LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT runtime NAMELINK_COMPONENT development)
  install(EXPORT ${_export} NAMESPACE AccessVDB:: DESTINATION ${_package} COMPONENT development)
endforeach()
set_target_properties(accessvdb_api PROPERTIES EXPORT_NAME api)

if(TARGET accessvdb_cli)
  install(TARGETS accessvdb_cli RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT runtime)
endif()
if(TARGET accessvdb_lab)
  install(TARGETS accessvdb_lab RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT lab)
endif()
install(FILES ${PROJECT_SOURCE_DIR}/LICENSE ${PROJECT_SOURCE_DIR}/README.md ${PROJECT_SOURCE_DIR}/CHANGELOG.md
        ${PROJECT_SOURCE_DIR}/docs/licences.md DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/accessvdb COMPONENT runtime)
# Licence texts of code that is compiled in and has no library whose package would bring them.
foreach(_headers IN ITEMS libcli11-dev libeigen3-dev libnanovdb-dev nlohmann-json3-dev)
  if(EXISTS /usr/share/doc/${_headers}/copyright)
    install(FILES /usr/share/doc/${_headers}/copyright DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/accessvdb/licences
            RENAME ${_headers} COMPONENT runtime)
  endif()
endforeach()

# The features that this build has, as components of find_package.
set(ACCESSVDB_FEATURES core io)
if(ACCESSVDB_HAS_CUDA)
  list(APPEND ACCESSVDB_FEATURES cuda)
endif()
configure_package_config_file(${PROJECT_SOURCE_DIR}/cmake/AccessVDBConfig.cmake.in
  ${PROJECT_BINARY_DIR}/package/AccessVDBConfig.cmake INSTALL_DESTINATION ${_package} NO_SET_AND_CHECK_MACRO)
write_basic_package_version_file(${PROJECT_BINARY_DIR}/package/AccessVDBConfigVersion.cmake
  COMPATIBILITY SameMinorVersion)  # SameMajorVersion from 1.0 on
install(FILES ${PROJECT_BINARY_DIR}/package/AccessVDBConfig.cmake ${PROJECT_BINARY_DIR}/package/AccessVDBConfigVersion.cmake
        DESTINATION ${_package} COMPONENT development)

# pkg-config: OpenVDB has no file there, and its definitions change its classes, so they are included.
get_target_property(_definitions OpenVDB::openvdb INTERFACE_COMPILE_DEFINITIONS)
set(ACCESSVDB_PC_DEFINITIONS "")
if(_definitions)
  list(TRANSFORM _definitions PREPEND "-D" OUTPUT_VARIABLE ACCESSVDB_PC_DEFINITIONS)
  list(JOIN ACCESSVDB_PC_DEFINITIONS " " ACCESSVDB_PC_DEFINITIONS)
endif()
set(ACCESSVDB_PC_REQUIRES "eigen3, tbb, Imath")
set(ACCESSVDB_PC_LIBS "-lopenvdb")
set(ACCESSVDB_PC_REQUIRES_PRIVATE "libpng, zlib, libcrypto")
set(ACCESSVDB_PC_LIBS_PRIVATE "-llzf -lassimp -lbz2 -llz4 -lsqlite3 -lz -lzstd")
if(ACCESSVDB_HAS_CUDA)
  string(APPEND ACCESSVDB_PC_LIBS_PRIVATE " -L${CUDAToolkit_LIBRARY_DIR} -lcudart_static -ldl -lrt -lpthread")
endif()
if(NOT shared IN_LIST ACCESSVDB_KINDS)  # only a static library: every link needs the private dependencies
  string(APPEND ACCESSVDB_PC_REQUIRES ", ${ACCESSVDB_PC_REQUIRES_PRIVATE}")
  string(APPEND ACCESSVDB_PC_LIBS " ${ACCESSVDB_PC_LIBS_PRIVATE}")
endif()
file(RELATIVE_PATH ACCESSVDB_PC_PREFIX /prefix/${CMAKE_INSTALL_LIBDIR}/pkgconfig /prefix)
configure_file(${PROJECT_SOURCE_DIR}/cmake/accessvdb.pc.in ${PROJECT_BINARY_DIR}/package/accessvdb.pc @ONLY)
install(FILES ${PROJECT_BINARY_DIR}/package/accessvdb.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig COMPONENT development)
