// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// A libcuda.so.1 for tests: a driver without a GPU that answers as instructed, so that the built program, with the real
// CUDA runtime, meets old, broken and empty drivers on any machine. Controlled by the environment:
//   STUB_DRIVER_VERSION  as from cuDriverGetVersion, for example 11040; 0 = the runtime finds no driver
//   STUB_DRIVER_INIT     what cuInit returns: 100 no device, 999 unknown, 802 not ready, 2 no memory, ...
//   STUB_DRIVER_LOADED   if set, and this library is preloaded: the kernel has its part of a driver
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

enum { kNotFound = 500 };

static int told(const char* name, int otherwise) {
  const char* value = getenv(name);
  return value != NULL ? atoi(value) : otherwise;
}

int stat(const char* restrict path, struct stat* restrict status) {
  if (getenv("STUB_DRIVER_LOADED") != NULL && strcmp(path, "/proc/driver/nvidia/version") == 0) {
    memset(status, 0, sizeof *status);
    status->st_mode = S_IFREG;
    return 0;
  }
  int (*real)(const char*, struct stat*) = (int (*)(const char*, struct stat*))dlsym(RTLD_NEXT, "stat");
  return real(path, status);
}

int cuDriverGetVersion(int* version) {
  *version = told("STUB_DRIVER_VERSION", 99000);
  return 0;
}

int cuInit(unsigned flags) {
  (void)flags;
  return told("STUB_DRIVER_INIT", 100);
}

int cuGetExportTable(const void** table, const void* id) {
  (void)id;
  *table = NULL;
  return kNotFound;
}

int cuGetProcAddress_v2(const char* symbol, void** address, int version, unsigned long long flags, int* found) {
  (void)version;
  (void)flags;
  // Only this library, wherever it is.
  Dl_info self;
  void* library = NULL;
  if (dladdr((void*)&cuGetProcAddress_v2, &self) != 0) library = dlopen(self.dli_fname, RTLD_LAZY | RTLD_NOLOAD);
  *address = NULL;
  if (library != NULL) {
    *address = dlsym(library, symbol);
    if (*address == NULL) {
      char second[128];
      snprintf(second, sizeof second, "%s_v2", symbol);
      *address = dlsym(library, second);
    }
  }
  if (found != NULL) *found = *address != NULL ? 0 : 1;
  return *address != NULL ? 0 : kNotFound;
}
