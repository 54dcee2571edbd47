# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""The tools builtin:pencil and builtin:pruner as triangle meshes in the tool frame, metres. Does not need Blender.

The same shapes as in src/tool/builtin_tools.cpp; a test compares them vertex by vertex.
"""

import math

from .points_ply import FieldError

_SIDES = 24


def builtin_mesh(name):
    """(vertices, triangles) of a built-in tool: lists of 3-tuples. Raises FieldError for any other name."""
    mesh = ([], [])
    if name == "builtin:pencil":
        _add_turned(mesh, [(0, 0), (0.02, 0.004), (0.15, 0.004)])
    elif name == "builtin:pruner":
        _add_turned(mesh, [(0, 0.006), (0.05, 0.025), (0.08, 0.025)])
        _add_turned(mesh, [(0.07, 0.018), (0.65, 0.018)])
        _add_box(mesh, (0.6, -0.25, -0.1), (1.1, 0.25, 0.1))
    else:
        raise FieldError(f"{name}: no built-in tool with this name. Use builtin:pencil, builtin:pruner or a mesh")
    return mesh


def _add_turned(mesh, rings):
    """A closed body of revolution around +x; rings are (x, radius). A ring of radius 0 is an apex."""
    vertices, triangles = mesh
    starts = []
    for x, radius in rings:
        starts.append(len(vertices))
        sides = _SIDES if radius > 0 else 1
        for s in range(sides):
            angle = 2 * math.pi * s / _SIDES
            vertices.append((x, radius * math.cos(angle), radius * math.sin(angle)))
    for (a, (_, radius_a)), (b, (_, radius_b)) in zip(zip(starts, rings), zip(starts[1:], rings[1:])):
        for s in range(_SIDES):
            t = (s + 1) % _SIDES
            if radius_a > 0:
                triangles.append((a + s, b + (s if radius_b > 0 else 0), a + t))
            if radius_b > 0:
                triangles.append((a + (t if radius_a > 0 else 0), b + s, b + t))
    for start, (x, radius), order in ((starts[0], rings[0], 1), (starts[-1], rings[-1], -1)):
        if radius > 0:
            centre = len(vertices)
            vertices.append((x, 0.0, 0.0))
            for s in range(_SIDES):
                rim = (start + s, start + (s + 1) % _SIDES)[::order]
                triangles.append((centre,) + rim)


def _add_box(mesh, low, high):
    vertices, triangles = mesh
    base = len(vertices)
    for corner in range(8):
        vertices.append(tuple((high if corner >> axis & 1 else low)[axis] for axis in range(3)))
    for f in ((0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6)):
        triangles.append((base + f[0], base + f[1], base + f[2]))
        triangles.append((base + f[0], base + f[2], base + f[3]))
