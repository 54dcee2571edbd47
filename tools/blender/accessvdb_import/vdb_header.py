# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Is a .vdb file complete, and what grids does it say it has? Needs neither OpenVDB nor Blender.

Blender 3.4 dies of an uncaught exception when it opens a truncated .vdb, so the add-on checks first. It walks from grid
to grid by the offsets at the beginning of each grid, and reads no voxels.
"""

import os
import struct

from .points_ply import FieldError

_MAGIC = 0x56444220  # " BDV", as OpenVDB writes it into 8 bytes
_OLDEST_FORMAT = 222  # written by OpenVDB since 2013; AccessVDB never wrote an older one
_MAX_TEXT = 1 << 16
_MAX_ENTRIES = 1 << 16
_ADVICE = "Copy or compute it again"


def check_volume(path, needed):
    """Names of the grids in a .vdb. Raises FieldError for a file that is not a .vdb, is truncated, lacks one of the
    grids `needed`, or was not written by AccessVDB."""
    try:
        with open(path, "rb") as stream:
            metadata, grids = _walk(_Reader(stream, os.path.getsize(path), path))
    except OSError as error:
        raise FieldError(f"{path}: {error.strerror or error}. {_ADVICE}") from None
    missing = [name for name in needed if name not in grids]
    if missing or "accessvdb_version" not in metadata:
        why = f"no grid '{missing[0]}'; grids: {', '.join(grids) or 'none'}" if missing else "another program wrote it"
        raise FieldError(f"{path}: is not a field of AccessVDB ({why}). Choose field.vdb of an accessvdb map run")
    return grids


class _Reader:
    """Little-endian values of a file, each checked against its end."""

    def __init__(self, stream, size, path):
        self.stream, self.size, self.path = stream, size, path

    def damaged(self, why):
        return FieldError(f"{self.path}: is damaged or truncated ({why}). {_ADVICE}")

    def values(self, layout):
        data = self.stream.read(struct.calcsize(layout))
        if len(data) < struct.calcsize(layout):
            raise self.damaged("it ends too early")
        return struct.unpack(layout, data)

    def text(self):
        (length,) = self.values("<I")
        if length > _MAX_TEXT:
            raise self.damaged(f"a name of {length} bytes")
        return self.values(f"<{length}s")[0].decode("utf-8", "replace")

    def go_to(self, position):
        if not self.stream.tell() <= position <= self.size:
            raise self.damaged(f"{self.size} bytes, but a grid reaches to byte {position}")
        self.stream.seek(position)


def _walk(reader):
    if reader.size < 8 or reader.values("<q") != (_MAGIC,):
        raise FieldError(f"{reader.path}: is not a .vdb file. Choose field.vdb of an accessvdb map run")
    version, _, _, has_offsets = reader.values("<IIIB")
    if version < _OLDEST_FORMAT or not has_offsets:
        raise FieldError(f"{reader.path}: is not a field of AccessVDB (format {version}). "
                         "Choose field.vdb of an accessvdb map run")
    reader.values("<36s")  # the file's identifier
    metadata = _metadata_names(reader)
    (count,) = reader.values("<i")
    if not 0 <= count <= _MAX_ENTRIES:
        raise reader.damaged(f"{count} grids")
    grids = []
    for _ in range(count):
        # Grids of the same name are distinguished by a suffix after a separator.
        grids.append(reader.text().split("\x1e")[0])
        reader.text()  # type
        reader.text()  # the grid whose voxels it shares
        begin, _, end = reader.values("<qqq")
        if not reader.stream.tell() <= begin <= end:
            raise reader.damaged(f"grid '{grids[-1]}' ends before it begins")
        reader.go_to(end)
    if reader.stream.tell() != reader.size:
        raise reader.damaged(f"{reader.size - reader.stream.tell()} bytes after the last grid")
    return metadata, grids


def _metadata_names(reader):
    (count,) = reader.values("<I")
    if count > _MAX_ENTRIES:
        raise reader.damaged(f"{count} metadata")
    names = set()
    for _ in range(count):
        names.add(reader.text())
        reader.text()  # type
        (length,) = reader.values("<I")
        reader.go_to(reader.stream.tell() + length)
    return names
