# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Blender add-on: opens the output folder of `accessvdb map`, and places the tool at one of its points or approaches.

File > Import > Accessibility field (AccessVDB), Object > Place tool at point (AccessVDB), and Object > Place tool at
approach (AccessVDB). See README.md next to this folder. Written for Blender 3.4 and later; differences between versions
are checked where they matter.
"""

bl_info = {
    "name": "Accessibility field (AccessVDB)",
    "author": "Contributors to the AccessVDB project",
    "version": (0, 1, 0),
    "blender": (3, 4, 0),
    "location": "File > Import > Accessibility field (AccessVDB); Object > Place tool at point (AccessVDB)",
    "description": "Opens accessibility fields: volume, points with attributes, and the tool at a point",
    "category": "Import-Export",
}

# Files that do not need Blender stay importable without it.
try:
    import bpy
except ImportError:
    bpy = None

if bpy is not None:
    from . import approach_operator, import_operator, place_operator

    def register():
        import_operator.register()
        place_operator.register()
        approach_operator.register()

    def unregister():
        approach_operator.unregister()
        place_operator.unregister()
        import_operator.unregister()
