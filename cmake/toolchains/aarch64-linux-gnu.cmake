# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# For 64-bit ARM, with a Debian compiler and a root of Debian packages for arm64 (tools/platforms/arm64.sh makes one):
#   cmake --toolchain cmake/toolchains/aarch64-linux-gnu.cmake -DACCESSVDB_SYSROOT=ROOT ...
# Tests run under qemu-user, if it is installed.
list(APPEND CMAKE_TRY_COMPILE_PLATFORM_VARIABLES ACCESSVDB_SYSROOT)
if(NOT IS_DIRECTORY "${ACCESSVDB_SYSROOT}/usr/lib/aarch64-linux-gnu")
  message(FATAL_ERROR "ACCESSVDB_SYSROOT must name a root of Debian packages for arm64: tools/platforms/arm64.sh makes one")
endif()
set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_SYSTEM_PROCESSOR aarch64)
set(CMAKE_LIBRARY_ARCHITECTURE aarch64-linux-gnu)
set(CMAKE_C_COMPILER aarch64-linux-gnu-gcc)
set(CMAKE_CXX_COMPILER aarch64-linux-gnu-g++)
set(CMAKE_SYSROOT ${ACCESSVDB_SYSROOT})
set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)
foreach(_kind IN ITEMS LIBRARY INCLUDE PACKAGE)
  set(CMAKE_FIND_ROOT_PATH_MODE_${_kind} ONLY)
endforeach()
# Libraries of libraries are found in the root, and not in the paths of this machine.
set(CMAKE_EXE_LINKER_FLAGS_INIT "-Wl,-rpath-link,${CMAKE_SYSROOT}/usr/lib/aarch64-linux-gnu")
set(CMAKE_SHARED_LINKER_FLAGS_INIT ${CMAKE_EXE_LINKER_FLAGS_INIT})
find_program(_qemu NAMES qemu-aarch64 qemu-aarch64-static NAMES_PER_DIR)
if(_qemu)
  set(CMAKE_CROSSCOMPILING_EMULATOR ${_qemu};-L;${CMAKE_SYSROOT})
endif()
