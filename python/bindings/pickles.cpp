// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "bindings/pickles.h"

#include "accessvdb/config.h"
#include "accessvdb/error.h"

namespace py = pybind11;

namespace accessvdb::python {
namespace {

/// Of this program. Raise the number when what is written of any class changes.
constexpr const char* kPickleVersion = ACCESSVDB_VERSION " (1)";

py::bytes sha256Of(const char* class_name, const py::bytes& bytes) {
  const py::object hash = py::module_::import("hashlib").attr("sha256")(py::bytes(class_name));
  hash.attr("update")(bytes);
  return hash.attr("digest")();
}

}  // namespace

void PickleReader::refuse() const {
  throw InputError("pickle.damaged", class_name_, "its pickle is damaged", "Pickle it again, and keep every byte");
}

py::tuple pickleState(const char* class_name, const PickleWriter& written) {
  const py::bytes bytes(written.bytes());
  return py::make_tuple(kPickleVersion, sha256Of(class_name, bytes), bytes);
}

std::string bytesOfState(const char* class_name, const py::tuple& state) {
  const PickleReader pickle(class_name, {});
  if (state.empty() || !py::isinstance<py::str>(state[0])) pickle.refuse();
  const auto version = state[0].cast<std::string>();
  if (version != kPickleVersion) {
    throw InputError("pickle.version", class_name,
                     "it was pickled by version " + version + " of accessvdb, and this is " + kPickleVersion,
                     "Pickle it again with this version");
  }
  if (state.size() != 3 || !py::isinstance<py::bytes>(state[2])) pickle.refuse();
  const py::bytes bytes = state[2];
  if (!sha256Of(class_name, bytes).equal(state[1])) pickle.refuse();
  return bytes;
}

}  // namespace accessvdb::python
