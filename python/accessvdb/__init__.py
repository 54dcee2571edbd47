# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Which surfaces of a scanned scene can a tool reach, from which direction, and if not, why not.

    tool = accessvdb.ToolGeometry.builtin("builtin:pruner")
    field = accessvdb.AccessibilityField(tool, {"tsdf": {"voxel_size_m": 0.05}})
    for points_S, T_W_S in scans:  # (N, 3) in the sensor frame, (4, 4) sensor to world
        field.integrate_scan(points_S, T_W_S)
    field.update()
    snapshot = field.snapshot()
    reachable = snapshot.position_W[snapshot.label == accessvdb.PointLabel.ACCESSIBLE]

Lengths are metres, angles radians. Suffixes: _W world frame, _S sensor frame, _T tool frame.
"""

from ._errors import (
    DeviceError,
    Error,
    InputError,
    InternalError,
    InvalidArgument,
    OutputError,
    ResourceLimit,
    UnusableInput,
)
try:
    from ._accessvdb import (
        NO_DIRECTION,
        NO_POINT,
        NO_ATTRIBUTE,
        NO_SCORE,
        AccessMap,
        AccessibilityField,
        ApproachParams,
        CapsuleAnswers,
        FitAnswers,
        PathFit,
        ChangeParams,
        Cut,
        CutOrder,
        DistanceGrid,
        FieldParams,
        FieldSnapshot,
        FrameStats,
        LiveSession,
        LiveStep,
        MemoryUse,
        PointAnswers,
        PointLabel,
        PointReason,
        ProjectiveParams,
        Region,
        Removal,
        RollingField,
        ScanAgreement,
        ScanRecord,
        ScanSequence,
        ScoringParams,
        StoredAnswer,
        StoredField,
        StoredTiles,
        SurfacePoint,
        ToolGeometry,
        ToolSpec,
        TsdfParams,
        UpdateParams,
        UpdateStats,
        UpdateTicket,
        WhatIf,
        __version__,
        read_points_ply,
        render_access_map,
        render_field,
        render_tool,
        with_margins,
    )
except ImportError as _error:
    # accessvdb.tiles only starts programs, also on machines without the compiled module. All else needs it: whoever asks
    # for a name of it gets the error that importing it gave.
    from ._errors import import_error as _in_words

    _import_error = _in_words(_error, __file__)

    def __getattr__(name):
        from importlib.util import find_spec

        if (name.startswith("_") and name != "__version__") or find_spec(f"{__name__}.{name}"):
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        raise _import_error.with_traceback(None)


__all__ = [_name for _name in dir() if not _name.startswith("_")] + ["__version__"]

for _name in __all__:
    # Users import from here, so errors and reprs name this place too.
    if isinstance(globals().get(_name), type):
        globals()[_name].__module__ = "accessvdb"
