# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""A tool without symmetry, as three boxes in a frame and unit different from the library's: wrong handedness, a swapped
axis or a wrong unit puts it somewhere else."""

import struct

UNIT = "mm"
TIP = (40.0, 0.0, 120.0)
AXIS = (0.0, 0.0, -1.0)
UP = (0.0, 1.0, 0.0)
#: Corners (low, high), mm: a rod, a hook to one side, a fin upwards.
BOXES = (((36, -4, 0), (44, 4, 120)), ((44, -4, 50), (84, 4, 70)), ((36, 4, 20), (44, 24, 40)))


def corners():
    """The 8 corners of each box, in the order of BOXES."""
    return [tuple((box[1] if k >> axis & 1 else box[0])[axis] for axis in range(3)) for box in BOXES for k in range(8)]


def triangles():
    """12 per box, as triples of corners."""
    at, faces = corners(), ((0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6))
    for box in range(len(BOXES)):
        for a, b, c, d in faces:
            yield at[8 * box + a], at[8 * box + b], at[8 * box + c]
            yield at[8 * box + a], at[8 * box + c], at[8 * box + d]


def write_stl(path):
    """Binary STL."""
    rows = list(triangles())
    with open(path, "wb") as stream:
        stream.write(bytes(80) + struct.pack("<I", len(rows)))
        for a, b, c in rows:
            stream.write(struct.pack("<12fH", 0, 0, 0, *a, *b, *c, 0))
