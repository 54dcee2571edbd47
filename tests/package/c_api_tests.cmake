# The C interface against the C++ one, and against misuse.
accessvdb_test(c_api_test TOGETHER c_api_carry_test.cpp c_api_misuse_test.cpp c_api_parity_test.cpp c_api_query_test.cpp c_api_region_test.cpp c_api_rolling_test.cpp c_api_tools_test.cpp LINKS accessvdb_sample_scans LABELS package)

# A test program in C, so that a C compiler reads the header: C99 without extensions.
add_executable(c_api_in_c c_api_in_c.c)
accessvdb_target(c_api_in_c)
set_target_properties(c_api_in_c PROPERTIES C_STANDARD 99 C_STANDARD_REQUIRED ON C_EXTENSIONS OFF LINKER_LANGUAGE CXX)
target_link_libraries(c_api_in_c PRIVATE AccessVDB::accessvdb)
add_test(NAME package.c_api_in_c COMMAND sh -c "rm -rf \"$1\" && exec \"$0\" \"$1\""
         $<TARGET_FILE:c_api_in_c> ${CMAKE_CURRENT_BINARY_DIR}/c_api_in_c_out)
set_tests_properties(package.c_api_in_c PROPERTIES LABELS package)

# A program built with the header of version 2 runs with this library.
add_executable(c_api_old_program c_api_2/old_program.c)
accessvdb_target(c_api_old_program)
set_target_properties(c_api_old_program PROPERTIES C_STANDARD 99 C_STANDARD_REQUIRED ON C_EXTENSIONS OFF LINKER_LANGUAGE CXX)
target_link_libraries(c_api_old_program PRIVATE AccessVDB::accessvdb)
add_test(NAME package.c_api_old_program COMMAND c_api_old_program)
set_tests_properties(package.c_api_old_program PROPERTIES LABELS package)
