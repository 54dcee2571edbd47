// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which symbols libaccessvdb.so exports: those marked ACCESSVDB_API, listed in cmake/libaccessvdb.map; a test compares
/// the two. For C and C++, and the same in the static and the shared library.
#pragma once

#if defined(__GNUC__) || defined(__clang__)
#define ACCESSVDB_API __attribute__((visibility("default")))
/// Private parts of a public class (the Impl structs).
#define ACCESSVDB_PRIVATE __attribute__((visibility("hidden")))
#else
#define ACCESSVDB_API
#define ACCESSVDB_PRIVATE
#endif
