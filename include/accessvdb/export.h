// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What libaccessvdb.so shows to others: what ACCESSVDB_API marks, by the list in cmake/libaccessvdb.map; a test holds
/// the two against each other. Good for C and C++, and the same in the static and in the shared library.
#pragma once

#if defined(__GNUC__) || defined(__clang__)
#define ACCESSVDB_API __attribute__((visibility("default")))
/// Parts of a public class that are nobody's business (the Impl structs).
#define ACCESSVDB_PRIVATE __attribute__((visibility("hidden")))
#else
#define ACCESSVDB_API
#define ACCESSVDB_PRIVATE
#endif
