# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""A drone whose boom tilts while its body stays level: one mesh for each angle of the boom.

    python3 tilting_boom.py booms/ -45 0 45
    accessvdb map ... $(cat booms/flags.txt)

Body and boom are not one rigid tool, so the field gets several tools, each of which only turns about the vertical:
the boom of each comes at its own pitch, and its body is level there. Needs nothing but Python.
"""

import argparse
import math
import os
import struct
import sys

BOOM_M, BOOM_THICK_M = 1.2, 0.03  # from the tip to the joint
BODY_M = (0.5, 0.5, 0.15)  # length, width, height, around the joint
ROTORS_M, ROTORS_ABOVE_M = (1.0, 1.0, 0.04), 0.12  # what the blades sweep, and its centre above the joint


def box(center, size, turned):
    """12 triangles, each three corners; turned: of a point about the box's origin."""
    corners = [
        turned([center[axis] + (0.5 if bit >> axis & 1 else -0.5) * size[axis] for axis in range(3)])
        for bit in range(8)
    ]
    triangles = []
    for axis in range(3):
        u, v = 1 << (axis + 1) % 3, 1 << (axis + 2) % 3
        for side in (0, 1 << axis):
            quad = [side, side | u, side | u | v, side | v]
            if not side:
                quad.reverse()  # seen from outside, counter-clockwise
            triangles += [[corners[quad[0]], corners[quad[1]], corners[quad[2]]],
                          [corners[quad[0]], corners[quad[2]], corners[quad[3]]]]
    return triangles


def boom(pitch_deg):
    """The tool in its own frame, metres: the tip is the origin and +x runs along the boom.

    pitch_deg  of the boom, as in --orientations: at +45 the boom points up from the tip, so the drone is above it
    """
    c, s = math.cos(math.radians(pitch_deg)), math.sin(math.radians(pitch_deg))
    # What is level in the world is turned back by the pitch in the tool's frame.
    level = lambda p: [c * p[0] + s * p[2] + BOOM_M, p[1], -s * p[0] + c * p[2]]
    along = lambda p: p
    return (box((BOOM_M / 2, 0, 0), (BOOM_M, BOOM_THICK_M, BOOM_THICK_M), along)
            + box((0, 0, 0), BODY_M, level)
            + box((0, 0, ROTORS_ABOVE_M), ROTORS_M, level))


def write_stl(path, triangles):
    with open(path, "wb") as stream:
        stream.write(b"AccessVDB example: boom".ljust(80) + struct.pack("<I", len(triangles)))
        for triangle in triangles:
            stream.write(struct.pack("<12fH", 0, 0, 0, *(x for corner in triangle for x in corner), 0))


def name_of(pitch_deg):
    return f"boom_{'down' if pitch_deg < 0 else 'up'}_{abs(pitch_deg):g}".replace(".", "_") if pitch_deg else "boom_level"


def main(arguments):
    parser = argparse.ArgumentParser(description="One mesh for each angle of a boom below or above a level drone.")
    parser.add_argument("folder")
    parser.add_argument("pitch_deg", nargs="+", type=float, help="angles of the boom, -90 .. 90; the best one first")
    given = parser.parse_args(arguments)
    os.makedirs(given.folder, exist_ok=True)
    flags = ["--tool-unit m"]
    for pitch_deg in given.pitch_deg:
        path = os.path.join(given.folder, name_of(pitch_deg) + ".stl")
        write_stl(path, boom(pitch_deg))
        ring = f"pitch:{pitch_deg:g}:{pitch_deg:g}:1"
        flags.append(f"--tool {path} --tool-name {name_of(pitch_deg)} --orientations {ring}")
    with open(os.path.join(given.folder, "flags.txt"), "w", encoding="utf-8") as stream:
        stream.write("\n".join(flags) + "\n")
    print(" ".join(flags))


if __name__ == "__main__":
    main(sys.argv[1:])
