"""The scene of a recording for common viewers of MCAP: array, foci, and events in words.

The fields are those of the JSON schemas that Foxglove and Lichtblick know by name. Lengths are in
centimetres: an array fills the first view of these programs, which looks from 20 units away.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

Fields = dict[str, Any]

INFO, WARNING, ERROR = 2, 3, 4  # levels of a log
_CM: Final = 100.0
_NS_PER_S: Final = 1_000_000_000
_AXES: Final = "haptogram"  # the frame of reference
_WORLD: Final = "world"
_GREY: Final = (0.55, 0.55, 0.55, 1.0)
_TARGET: Final = (0.84, 0.37, 0.0, 0.8)
_FOUND: Final = (0.0, 0.45, 0.7, 1.0)
_TARGET_CM, _FOUND_CM = 0.8, 0.5  # diameters

# --- Schemas -----------------------------------------------------------------------------------


def _numbers(*names: str) -> Fields:
    """Return the JSON schema of an object with a number for each of *names*."""
    return {"type": "object", "properties": {name: {"type": "number"} for name in names}}


def _object(**properties: Fields) -> Fields:
    """Return the JSON schema of an object with *properties*, a schema for each name."""
    return {"type": "object", "properties": properties}


def _array(**properties: Fields) -> Fields:
    """Return the JSON schema of an array of objects with *properties*, a schema for each name."""
    return {"type": "array", "items": _object(**properties)}


_TEXT: Final = {"type": "string"}
_WHOLE: Final = {"type": "integer"}
_TIME: Final = _object(sec=_WHOLE, nsec=_WHOLE)
_VECTOR, _TURN, _COLOUR = _numbers("x", "y", "z"), _numbers("x", "y", "z", "w"), _numbers(*"rgba")
_SOLID: Final = _array(
    pose=_object(position=_VECTOR, orientation=_TURN), size=_VECTOR, color=_COLOUR
)
_UNUSED: Final = ("arrows", "cubes", "cylinders", "lines", "triangles", "texts", "models")

LOG_SCHEMA: Final = {
    "timestamp": _TIME,
    "level": _WHOLE,
    "message": _TEXT,
    "name": _TEXT,
    "file": _TEXT,
    "line": _WHOLE,
}
FRAME_SCHEMA: Final = {
    "timestamp": _TIME,
    "parent_frame_id": _TEXT,
    "child_frame_id": _TEXT,
    "translation": _VECTOR,
    "rotation": _TURN,
}
SCENE_SCHEMA: Final = {
    "deletions": _array(timestamp=_TIME, type=_WHOLE, id=_TEXT),
    "entities": _array(
        timestamp=_TIME,
        frame_id=_TEXT,
        id=_TEXT,
        lifetime=_TIME,
        frame_locked={"type": "boolean"},
        metadata=_array(key=_TEXT, value=_TEXT),
        spheres=_SOLID,
        **dict.fromkeys(_UNUSED, _array()),
    ),
}

# --- Messages ----------------------------------------------------------------------------------


def log_of_recording(t_ns: int, message: str, level: int = INFO) -> Fields:
    """Return an event in words."""
    about = {"timestamp": _time(t_ns), "level": level, "message": message}
    return about | {"name": "haptogram", "file": "", "line": 0}


def axes_of_recording() -> Fields:
    """Return the axes of the scene, without which a viewer shows none."""
    names = {"parent_frame_id": _WORLD, "child_frame_id": _AXES}
    return {"timestamp": _time(0), **names, "translation": _vector((0, 0, 0)), "rotation": _turn()}


def array_of_recording(positions_m: Sequence[Sequence[float]], pitch_m: float) -> Fields:
    """Return the elements of an array as flat spheres, *pitch_m* wide."""
    size = (0.9 * _CM * pitch_m, 0.9 * _CM * pitch_m, 0.1 * _CM * pitch_m)
    return _scene(0, "array", [_sphere(place, size, _GREY) for place in positions_m])


def focus_of_recording(
    t_ns: int,
    target_m: Sequence[float | None] | None,
    found_m: Sequence[float | None] | None,
) -> Fields:
    """Return the target of a frame and its focus; what is not known is not drawn."""
    spheres = [
        _sphere(place, (width,) * 3, colour)
        for place, width, colour in (
            (target_m, _TARGET_CM, _TARGET),
            (found_m, _FOUND_CM, _FOUND),
        )
        if place is not None and None not in place
    ]
    return _scene(t_ns, "focus", spheres)


def _scene(t_ns: int, name: str, spheres: list[Fields]) -> Fields:
    """Return a scene update at *t_ns* that replaces the spheres of the entity *name*."""
    entity = {
        "timestamp": _time(t_ns),
        "frame_id": _AXES,
        "id": name,
        "lifetime": _time(0),
        "frame_locked": False,
        "metadata": [],
        "spheres": spheres,
        **{kind: [] for kind in _UNUSED},
    }
    return {"deletions": [], "entities": [entity]}


def _sphere(place_m: Sequence[Any], size_cm: Sequence[float], colour: Sequence[float]) -> Fields:
    """Return a sphere of a scene, drawn in cm; *colour* is red, green, blue, alpha, 0 to 1."""
    return {
        "pose": {"position": _vector(_CM * value for value in place_m), "orientation": _turn()},
        "size": _vector(size_cm),
        "color": dict(zip("rgba", colour, strict=True)),
    }


def _vector(values: Any) -> Mapping[str, float]:
    """Return three values as x, y and z of an object."""
    return dict(zip("xyz", values, strict=True))


def _turn() -> Mapping[str, float]:
    """Return the identity quaternion."""
    return {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}


def _time(t_ns: int) -> Mapping[str, int]:
    """Return a time as an object with seconds and nanoseconds; 0 for a negative one."""
    sec, nsec = divmod(max(0, t_ns), _NS_PER_S)
    return {"sec": sec, "nsec": nsec}
