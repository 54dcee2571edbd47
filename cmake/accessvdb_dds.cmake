# Whether the program of this build has the verb `live`, which needs a middleware: option ACCESSVDB_DDS, result
# ACCESSVDB_HAS_DDS. The library does not need it (accessvdb/live_session.h).
accessvdb_choice(ACCESSVDB_DDS "The verb live, over DDS" "Fast DDS is found")

set(ACCESSVDB_HAS_DDS OFF)
if(NOT ACCESSVDB_DDS STREQUAL "OFF" AND (ACCESSVDB_BUILD_TOOLS OR ACCESSVDB_BUILD_TESTS))
  # Release 3 is a package of another name. src/dds/fastdds_compat.h has what else differs.
  foreach(_package IN ITEMS fastdds fastrtps)
    find_package(${_package} QUIET)
    if(${_package}_FOUND AND TARGET ${_package} AND ${_package}_VERSION VERSION_GREATER_EQUAL 2.6
       AND ${_package}_VERSION VERSION_LESS 4)
      set(ACCESSVDB_HAS_DDS ON)
      set(ACCESSVDB_FASTDDS_TARGET ${_package})
      set(ACCESSVDB_FASTDDS_VERSION ${${_package}_VERSION})
      break()
    endif()
  endforeach()
  if(ACCESSVDB_HAS_DDS)
    message(STATUS "AccessVDB: live maps over DDS with Fast DDS ${ACCESSVDB_FASTDDS_VERSION}")
  elseif(ACCESSVDB_DDS STREQUAL "ON")
    message(FATAL_ERROR "ACCESSVDB_DDS is ON, but Fast DDS 2.6 to 3 was not found. On Debian and Ubuntu: "
                        "apt install libfastrtps-dev (newer ones: libfastdds-dev) libfastcdr-dev, or use ACCESSVDB_DDS=AUTO")
  elseif(PROJECT_IS_TOP_LEVEL)
    message(STATUS "AccessVDB: no Fast DDS; the program is built without its verb live")
  endif()
endif()
