# Compile flags for all our targets, and only for ours.
function(accessvdb_target name)
  target_compile_features(${name} PUBLIC cxx_std_20)
  set_target_properties(${name} PROPERTIES CXX_EXTENSIONS OFF POSITION_INDEPENDENT_CODE ON)
  set(_cxx $<NOT:$<COMPILE_LANGUAGE:CUDA>>)
  set(_cuda $<COMPILE_LANGUAGE:CUDA>)
  set(_strict $<BOOL:${ACCESSVDB_WARNINGS_AS_ERRORS}>)
  target_compile_options(${name} PRIVATE
    "$<${_cxx}:-Wall;-Wextra;-Wpedantic;-Wshadow>" "$<$<AND:${_cxx},${_strict}>:-Werror>"
    "$<${_cuda}:-Xcompiler=-Wall,-Wextra,-Wshadow>" "$<$<AND:${_cuda},${_strict}>:-Werror=all-warnings>")
  # No contraction of a*b+c anywhere: host and device must round alike, as must SIMD and scalar code.
  target_compile_options(${name} PRIVATE
    $<${_cxx}:-ffp-contract=off>
    "$<${_cuda}:--fmad=false;-prec-div=true;-prec-sqrt=true;-ftz=false;-Xcompiler=-ffp-contract=off>")
  if(ACCESSVDB_GRIDS_IN_LIBOPENVDB)
    target_compile_definitions(${name} PRIVATE ACCESSVDB_GRIDS_IN_LIBOPENVDB)  # for src/vdb
  endif()
  if(ACCESSVDB_SANITIZE)
    target_compile_options(${name} PRIVATE -fsanitize=${ACCESSVDB_SANITIZE} -fno-omit-frame-pointer -g1)
    target_link_options(${name} PUBLIC -fsanitize=${ACCESSVDB_SANITIZE})
    # A third of a program would be relocations of the sanitizer's notes, to be applied at each start.
    target_link_options(${name} PRIVATE $<$<STREQUAL:$<TARGET_PROPERTY:TYPE>,EXECUTABLE>:-no-pie>)
  endif()
endfunction()

# One folder of the library: an object library that becomes part of libaccessvdb.
#   accessvdb_layer(tsdf SOURCES a.cpp b.cpp LINKS OpenVDB::openvdb)
function(accessvdb_layer name)
  cmake_parse_arguments(LAYER "" "" "SOURCES;LINKS" ${ARGN})
  add_library(accessvdb_${name} OBJECT ${LAYER_SOURCES})
  accessvdb_target(accessvdb_${name})
  target_link_libraries(accessvdb_${name} PUBLIC ${LAYER_LINKS})
  set_property(GLOBAL APPEND PROPERTY ACCESSVDB_LAYERS accessvdb_${name})
endfunction()

# accessvdb_together(TARGET GROUP FILE...): sources of a target that share costly headers and no names. With
# ACCESSVDB_UNITY (the default for the top-level project), each group is compiled as one translation unit, which saves
# most of a cold build's time; compile options stay the same. If two names clash, rename one, choose another group, or
# leave the file out. Each group must compile in 2 GB. To find a missing #include, use ACCESSVDB_UNITY=OFF (preset dev).
#
# CMake's own UNITY_BUILD names files by their absolute paths, so ccache would miss them in another folder, and it
# leaves editors without an entry per file in compile_commands.json: the target NAME_GROUP_files, which is never built,
# provides these.
function(accessvdb_together target group)
  if(NOT ACCESSVDB_UNITY)
    return()
  endif()
  set(_text "")
  foreach(_file IN LISTS ARGN)
    file(RELATIVE_PATH _path ${PROJECT_SOURCE_DIR} ${CMAKE_CURRENT_SOURCE_DIR}/${_file})
    string(APPEND _text "#include \"${_path}\"\n")
  endforeach()
  set(_together ${CMAKE_BINARY_DIR}/together/${target}_${group}.cpp)
  file(CONFIGURE OUTPUT ${_together} CONTENT "${_text}" @ONLY)

  get_target_property(_sources ${target} SOURCES)
  list(REMOVE_ITEM _sources ${ARGN})
  set_target_properties(${target} PROPERTIES SOURCES "${_sources};${_together}")
  target_include_directories(${target} AFTER PRIVATE ${PROJECT_SOURCE_DIR})
  # GCC warns about unnamed namespaces outside the main file.
  target_compile_options(${target} PRIVATE "$<$<COMPILE_LANG_AND_ID:CXX,GNU>:-Wno-subobject-linkage>")

  if(CMAKE_EXPORT_COMPILE_COMMANDS)
    add_library(${target}_${group}_files OBJECT EXCLUDE_FROM_ALL ${ARGN})
    foreach(_property IN ITEMS INCLUDE_DIRECTORIES COMPILE_DEFINITIONS COMPILE_OPTIONS COMPILE_FEATURES)
      set_target_properties(${target}_${group}_files PROPERTIES ${_property} $<TARGET_PROPERTY:${target},${_property}>)
    endforeach()
    set_target_properties(${target}_${group}_files PROPERTIES CXX_EXTENSIONS OFF POSITION_INDEPENDENT_CODE ON)
  endif()
endfunction()
