# cpack -G "DEB;TGZ": one archive of everything, and two Debian packages, split like the components of the install rules.
set(CPACK_PACKAGE_NAME accessvdb)
set(CPACK_PACKAGE_VENDOR "Contributors to the AccessVDB project")
set(CPACK_PACKAGE_CONTACT "Contributors to the AccessVDB project <${PROJECT_HOMEPAGE_URL}>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "${PROJECT_DESCRIPTION}")
set(CPACK_RESOURCE_FILE_LICENSE ${PROJECT_SOURCE_DIR}/LICENSE)
set(CPACK_GENERATOR TGZ DEB)
set(CPACK_STRIP_FILES ON)
set(CPACK_COMPONENTS_ALL runtime development)
set(CPACK_ARCHIVE_COMPONENT_INSTALL OFF)
set(CPACK_THREADS 0)

set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_HOMEPAGE ${PROJECT_HOMEPAGE_URL})
set(CPACK_DEBIAN_RUNTIME_PACKAGE_NAME accessvdb)
set(CPACK_DEBIAN_RUNTIME_PACKAGE_SECTION science)
set(CPACK_DEBIAN_RUNTIME_PACKAGE_SHLIBDEPS ON)
set(CPACK_COMPONENT_RUNTIME_DESCRIPTION "The program, and the shared library with its C interface.")
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_NAME libaccessvdb-dev)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_DEPENDS
  "accessvdb (= ${PROJECT_VERSION}), libopenvdb-dev, libboost-iostreams-dev, libtbb-dev, libeigen3-dev")
# For users who link the static library or include device_view.h or pcl.h.
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_RECOMMENDS 
  "libassimp-dev, libbz2-dev, liblz4-dev, liblzf-dev, libpng-dev, libsqlite3-dev, libssl-dev, libzstd-dev, zlib1g-dev, libnanovdb-dev")
set(CPACK_COMPONENT_DEVELOPMENT_DESCRIPTION "Headers, libraries, CMake package and pkg-config file.")
include(CPack)
