# What planners bring: OMPL for accessvdb/ompl.h's tests, its example and the lab's table of plans (ACCESSVDB_OMPL), and
# OctoMap for export --octomap (ACCESSVDB_OCTOMAP). The library needs neither, and nothing that is installed does, except
# accessvdb/ompl.h, which is for users of OMPL.
accessvdb_choice(ACCESSVDB_OMPL "Tests, example and table of plans that use OMPL" "OMPL is found")
accessvdb_choice(ACCESSVDB_OCTOMAP "export --octomap" "OctoMap is found")

# accessvdb_planning_library(NAME HEADER LIBRARY... DEBIAN WITHOUT): an imported target accessvdb_<name>, result
# ACCESSVDB_HAS_<NAME>.
function(accessvdb_planning_library name header libraries debian without)
  set(ACCESSVDB_HAS_${name} OFF PARENT_SCOPE)
  if(ACCESSVDB_${name} STREQUAL "OFF" OR NOT PROJECT_IS_TOP_LEVEL)
    return()
  endif()
  find_path(ACCESSVDB_${name}_INCLUDE_DIR ${header} PATH_SUFFIXES ompl-1.5 ompl-1.6 ompl-1.7)
  mark_as_advanced(ACCESSVDB_${name}_INCLUDE_DIR)
  set(_found ${ACCESSVDB_${name}_INCLUDE_DIR})
  set(_links "")
  foreach(_library IN LISTS libraries)
    find_library(ACCESSVDB_${_library}_LIBRARY NAMES ${_library})
    mark_as_advanced(ACCESSVDB_${_library}_LIBRARY)
    list(APPEND _links ${ACCESSVDB_${_library}_LIBRARY})
    if(NOT ACCESSVDB_${_library}_LIBRARY)
      set(_found "")
    endif()
  endforeach()
  string(TOLOWER ${name} _target)
  if(_found)
    add_library(accessvdb_${_target} INTERFACE)
    target_include_directories(accessvdb_${_target} SYSTEM INTERFACE ${ACCESSVDB_${name}_INCLUDE_DIR})
    target_link_libraries(accessvdb_${_target} INTERFACE ${_links})
    set(ACCESSVDB_HAS_${name} ON PARENT_SCOPE)
  elseif(ACCESSVDB_${name} STREQUAL "ON")
    message(FATAL_ERROR "ACCESSVDB_${name} is ON, but ${header} or its library was not found. On Debian and Ubuntu: "
                        "apt install ${debian}, or use ACCESSVDB_${name}=AUTO")
  else()
    message(STATUS "AccessVDB: ${without} (apt install ${debian})")
  endif()
endfunction()

accessvdb_planning_library(OMPL ompl/base/StateSpace.h ompl libompl-dev "no OMPL; its tests, its example and the table of plans are not built")
accessvdb_planning_library(OCTOMAP octomap/OcTree.h "octomap;octomath" liboctomap-dev "no OctoMap; the program is built without export --octomap")
