# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""The contents of an output folder of `accessvdb map`, and the tool of the run. Does not need Blender."""

import json
import os
from dataclasses import dataclass

from .points_ply import FieldError
from .tool_frame import ToolPose

_ADVICE = "Choose the --out folder of an accessvdb map run, or the field.vdb in it"


@dataclass
class FieldFolder:
    """Paths of the files of one run; report is None if there is none."""

    folder: str
    volume: str
    points: str
    report: str


def find_field(path):
    """FieldFolder of a chosen folder, or of any file in it. Raises FieldError if there is no field."""
    path = os.path.abspath(path)
    if os.path.isdir(path):
        folder, volume = path, os.path.join(path, "field.vdb")
    elif os.path.isfile(path):
        folder = os.path.dirname(path)
        volume = path if path.endswith(".vdb") else os.path.join(folder, "field.vdb")
    else:
        raise FieldError(f"{path}: there is no such file or folder. {_ADVICE}")
    points = os.path.join(folder, "points.ply")
    if os.path.basename(volume) == "field_points.vdb":
        raise FieldError(f"{volume}: contains the points for Houdini. Choose field.vdb next to it")
    for file in (volume, points):
        if not os.path.isfile(file):
            raise FieldError(f"{folder}: contains no {os.path.basename(file)}. {_ADVICE}")
    # The report of a map in tiles is beside the folder of its tiles.
    reports = [os.path.join(folder, "report.json"), os.path.join(folder, "..", "..", "report.json")]
    return FieldFolder(folder, volume, points, next(filter(os.path.isfile, reports), None))


def find_fields(path):
    """The FieldFolder of find_field(), or one for each tile with points of a map in tiles (its folder or field.json).

    Raises FieldError.
    """
    path = os.path.abspath(path)
    index = path if os.path.basename(path) == "field.json" else os.path.join(path, "field.json")
    if not os.path.isfile(index):
        return [find_field(path)]
    try:
        with open(index, encoding="utf-8") as stream:
            folders = [str(tile["folder"]) for tile in json.load(stream)["tiles"] if tile["points"] > 0]
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise FieldError(f"{index}: cannot be read as the list of a map's tiles. Run accessvdb tile merge again") from None
    if not folders:
        raise FieldError(f"{index}: no tile has a surface point. {_ADVICE}")
    return [find_field(os.path.join(os.path.dirname(index), folder)) for folder in folders]


def tool_of_run(field, index=0):
    """The tool that the run was computed for, as (mesh path or builtin name, ToolPose). Raises FieldError.

    index  of several tools, the column `tool` of points.ply
    """
    advice = "Choose a tool mesh, with its unit, tip, axis and up"
    if field.report is None:
        raise FieldError(f"{field.folder}: contains no report.json, so the run's tool is not known. {advice}")
    try:
        with open(field.report, encoding="utf-8") as stream:
            report = json.load(stream)
        parameters = report["tools"][index] if "tools" in report else report["parameters"]
        names = ("tool", "tool_unit", "tool_tip", "tool_axis", "tool_up")
        text = {name: str(parameters.get(name, "")) for name in names}
    except (OSError, ValueError, KeyError, IndexError, TypeError, AttributeError):
        raise FieldError(f"{field.report}: cannot be read as the report of a run. {advice}") from None
    if not text["tool"]:
        raise FieldError(f"{field.report}: names no tool. {advice}")
    if text["tool"].startswith("builtin:"):
        return text["tool"], ToolPose()
    pose = ToolPose(unit=text["tool_unit"] or None,
                    tip=_vector(text["tool_tip"], (0.0, 0.0, 0.0), field.report),
                    axis=_vector(text["tool_axis"], (1.0, 0.0, 0.0), field.report),
                    up=_vector(text["tool_up"], (0.0, 0.0, 1.0), field.report))
    # The path is as typed: it may be relative to an unrecorded folder.
    for base in ("", field.folder, os.path.dirname(field.folder)):
        candidate = os.path.join(base, text["tool"])
        if os.path.isfile(candidate):
            return os.path.abspath(candidate), pose
    raise FieldError(f"{text['tool']}: the run's tool mesh cannot be found. {advice}")


def _vector(text, default, path):
    if not text:
        return default
    try:
        values = tuple(float(word) for word in text.split(","))
    except ValueError:
        values = ()
    if len(values) != 3:
        raise FieldError(f"{path}: '{text}' is not three numbers X,Y,Z")
    return values
