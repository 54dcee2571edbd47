# Whether the program of this build has the verb `live`, which needs a middleware: option ACCESSVDB_DDS, result
# ACCESSVDB_HAS_DDS. The library does not need it (accessvdb/live_session.h).
accessvdb_choice(ACCESSVDB_DDS "The verb live, over DDS" "Fast DDS is found")

set(ACCESSVDB_HAS_DDS OFF)
if(NOT ACCESSVDB_DDS STREQUAL "OFF" AND (ACCESSVDB_BUILD_TOOLS OR ACCESSVDB_BUILD_TESTS))
  find_package(fastrtps 2.6 QUIET)
  if(fastrtps_FOUND AND TARGET fastrtps)
    set(ACCESSVDB_HAS_DDS ON)
    message(STATUS "AccessVDB: live maps over DDS with Fast DDS ${fastrtps_VERSION}")
  elseif(ACCESSVDB_DDS STREQUAL "ON")
    message(FATAL_ERROR "ACCESSVDB_DDS is ON, but Fast DDS 2.6 or later was not found. On Debian and Ubuntu: "
                        "apt install libfastrtps-dev libfastcdr-dev, or use ACCESSVDB_DDS=AUTO")
  elseif(PROJECT_IS_TOP_LEVEL)
    message(STATUS "AccessVDB: no Fast DDS; the program is built without its verb live")
  endif()
endif()
