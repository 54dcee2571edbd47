# Target portable: the programs, the GPU suite and the benchmarks with their shared libraries in one archive that runs on
# another Linux machine. What this configuration does not build is omitted.
set(_programs "")
foreach(_target IN ITEMS accessvdb_cli accessvdb_lab gpu_parity_test gpu_faults_test tiles_equal_one_piece_test rolling_field_test accessvdb_bench_ceilings accessvdb_bench_gpu accessvdb_bench_stream own_kernel)
  if(TARGET ${_target})
    list(APPEND _programs ${_target})
  endif()
endforeach()
if(_programs)
  set(_files "")
  foreach(_target IN LISTS _programs)
    list(APPEND _files $<TARGET_FILE:${_target}>)
  endforeach()
  add_custom_target(portable
    COMMAND ${PROJECT_SOURCE_DIR}/tools/make_portable.sh
            ${PROJECT_BINARY_DIR}/accessvdb-${PROJECT_VERSION}-${CMAKE_SYSTEM_PROCESSOR}.tar.xz ${PROJECT_SOURCE_DIR}/tools ${_files}
    DEPENDS ${_programs} VERBATIM)
endif()
