"""Which array a board has: its geometry, and whether it is the one that the host assumes."""

from __future__ import annotations

from collections.abc import Sequence

from haptogram.acoustics import AcousticModel, Medium, Transducer, TransducerArray
from haptogram.driver.line.link import Link, request_parts
from haptogram.errors import ConfigurationError, WrongProtocolError
from haptogram.settings.arguments import check_argument_kind
from haptogram_protocol.messages import Element, GeometryReply, GetGeometry, HelloReply


def read_identified_array(link: Link, identity: HelloReply) -> TransducerArray:
    """Return the board's array: from the grid that HELLO names, else read element by element.

    Raises
    ------
    WrongProtocolError
        If the geometry that was read has not the hash that HELLO named.
    """
    if identity.grid_nx and identity.grid_ny:
        pitch_m = identity.pitch_um / 1e6
        grid = TransducerArray.grid(identity.grid_nx, identity.grid_ny, pitch_m=pitch_m)
        if grid.digest() == identity.geometry_hash:
            return grid
    return read_geometry(link, identity)


def read_geometry(link: Link, identity: HelloReply) -> TransducerArray:
    """Return the board's array, read element by element; see :func:`read_identified_array`."""
    count = identity.transducers
    parts = request_parts(link, count, GetGeometry, GeometryReply, lambda part: len(part.elements))
    array = array_of_geometry([element for part in parts for element in part.elements])
    if array.digest() != identity.geometry_hash:
        raise WrongProtocolError(
            f"{link.url}: geometry hash {array.digest():08x} of what was read; HELLO named "
            f"{identity.geometry_hash:08x}"
        )
    return array


def array_of_geometry(elements: Sequence[Element]) -> TransducerArray:
    """Return the array whose *elements* GET_GEOMETRY reports."""
    positions_um = [(e.x_um, e.y_um, e.z_um) for e in elements]
    return TransducerArray.from_wire(positions_um, [(e.nx, e.ny, e.nz) for e in elements])


def assumed_model_of_identity(
    link: Link, identity: HelloReply, model: AcousticModel | None, medium: Medium | None
) -> tuple[AcousticModel, list[str]]:
    """Return the model that the host assumes, and the warnings of :func:`_check_model`.

    Without *model* it is that of the board's own array in *medium*.
    """
    if model is None:
        model = model_of_identity(read_identified_array(link, identity), identity, medium)
    return model, _check_model(model, identity)


def model_of_identity(
    array: TransducerArray, identity: HelloReply, medium: Medium | None = None
) -> AcousticModel:
    """Return the model of a board's array in *medium*, by default air of 20 C."""
    transducer = Transducer(frequency_hz=float(identity.carrier_hz))
    air = medium or Medium.air(frequency_hz=transducer.frequency_hz)
    return AcousticModel(array, air, transducer)


def _check_model(model: AcousticModel, identity: HelloReply) -> list[str]:
    """Return a note if board and model have transducers at other places; [] if not.

    Raises
    ------
    ConfigurationError
        If they have not as many transducers, or another carrier frequency.
    """
    if model.array.count != identity.transducers:
        raise ConfigurationError(
            f"the model has {model.array.count} transducers, the board {identity.transducers}"
        )
    if model.frequency_hz != identity.carrier_hz:
        raise ConfigurationError(
            f"the model's carrier is {model.frequency_hz:g} Hz, the board's {identity.carrier_hz}"
        )
    if model.array.digest() != identity.geometry_hash:
        return [
            f"geometry hash {identity.geometry_hash:08x} of the board is not that of the model, "
            f"{model.array.digest():08x}: their transducers are not in the same places"
        ]
    return []


def check_air_of_identity(model: AcousticModel | None, medium: Medium | None) -> None:
    """Refuse a *medium* that is not the one of *model*.

    Raises
    ------
    ConfigurationError
        Naming both speeds of sound; or if either argument is of another type.
    """
    if model is not None:
        check_argument_kind("model", model, AcousticModel, "an AcousticModel, or None")
    if medium is not None:
        check_argument_kind("medium", medium, Medium, "a Medium, or None")
    if model is not None and medium is not None and model.medium != medium:
        raise ConfigurationError(
            f"medium has a speed of sound of {medium.sound_speed_m_s:g} m/s, that of the model "
            f"{model.medium.sound_speed_m_s:g} m/s; the model has its own: leave medium out"
        )
