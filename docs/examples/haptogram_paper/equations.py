"""Equations (1) to (9) of the paper: as printed, what is wrong with them, and as corrected.

Functions whose name ends in ``_printed`` compute what the paper prints, wrong units and all.
Symbols are the paper's.  All pressures P0 are RMS values, as the paper says.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class PaperConstants:
    """The parameters of section 4.1, as printed; the density is not printed and is that of 20 C.

    Attributes
    ----------
    frequency_hz, wavenumber : float
        40 kHz and 730.603 rad/m; together they mean a sound speed of 344.0 m/s.
    sound_speed_m_s : float
        340 m/s, printed beside them; used in the energy density only.
    attenuation_np_m : float
        beta, 1.00 dB/m.
    pressure_pa : float
        P0, 53 dB SPL; its digits are those of the wavelength in metres, 8.60e-3.
    alpha : float
        Reflection coefficient of the radiation pressure.
    pitch_m : float
        d, the side of a transducer's housing.
    """

    frequency_hz: float = 40e3
    wavenumber: float = 730.603
    sound_speed_m_s: float = 340.0
    attenuation_np_m: float = 0.115
    pressure_pa: float = 8.59e-3
    alpha: float = 2.0
    pitch_m: float = 0.010
    density_kg_m3: float = 1.2041


@dataclass(frozen=True, slots=True)
class PaperEquation:
    """One printed equation.

    Attributes
    ----------
    number : str
        As in the paper.
    printed, corrected : str
        Plain text.
    faults : tuple of str
        What is wrong with it, dimensions first; empty if nothing is.
    printed_unit, corrected_unit : str
        Unit of the right-hand side.
    """

    number: str
    printed: str
    corrected: str
    faults: tuple[str, ...]
    printed_unit: str
    corrected_unit: str


EQUATIONS: Final = (
    PaperEquation(
        "(1)",
        "P(x0,y0,z0) = sum_mn sqrt2 P(z0) e^{j(kr-wt)}",
        "P(x) = sum_n sqrt2 A_n e^{j phi_n} (P1/r_n) D(theta_n) e^{-beta r_n} e^{j(k r_n - wt)}",
        (
            "no phase per element, so nothing focuses; the text sets phi_n = -k r_n(target)",
            "no 1/r, which the text claims ('inversely proportional to r'), and no directivity",
        ),
        "Pa",
        "Pa (P1 in Pa m)",
    ),
    PaperEquation(
        "(2)",
        "r = sqrt((xm-x0)^2 + (ym-y0)^2 + z0^2)",
        "as printed",
        ("'focal length' in the text; it is the distance of one element from the point",),
        "m",
        "m",
    ),
    PaperEquation(
        "(3)",
        "P(z0) = P0 e^{-2 beta z0}",
        "P(r) = P0 e^{-beta r}",
        ("contradicts (6): energy falls with 2 beta, pressure with beta",),
        "Pa",
        "Pa",
    ),
    PaperEquation(
        "(4)",
        "E = I/C = P^2 / (rho C^2)",
        "E = p_rms^2 / (rho c^2)",
        ("holds for the RMS pressure of a plane wave; with a peak value it is twice too large",),
        "J/m^3",
        "J/m^3",
    ),
    PaperEquation(
        "(5)",
        "E(z0) = E0 e^{-2 beta z0}",
        "E(r) = E0 e^{-2 beta r}",
        (
            "the path is r, not z0: from 16 x 16 elements to the hemisphere E is 0.70 % less on "
            "average, and up to 2.1 % for one element",
        ),
        "J/m^3",
        "J/m^3",
    ),
    PaperEquation(
        "(6)",
        "P(z) = sqrt(E rho C^2) = P0 e^{-beta z}",
        "P(r) = P0 e^{-beta r}",
        ("right in itself; contradicts (3)",),
        "Pa",
        "Pa",
    ),
    PaperEquation(
        "(7)",
        "P(x0,y0,z0,t) = sum_mn sqrt2 P0 e^{-beta z0} e^{j(kr-wt)}",
        "as (1) corrected",
        (
            "as (1): every focus gets sqrt2 N P0 e^{-beta z0}, wherever it is",
            "'lossless' medium in section 4.1 contradicts beta",
        ),
        "Pa",
        "Pa",
    ),
    PaperEquation(
        "(8)",
        "F = alpha/(rho c^2) int int int |p|^3/3 dx0 dy0 dz0",
        "F = int int_A alpha p_rms^2/(rho c^2) dA",
        (
            "dimension: Pa^2 m^3 = N^2/m, not N; |p|^3/3 looks like an antiderivative of |p|^2",
            "radiation pressure acts on a surface, not in a volume",
            "|p| of (7) is a peak value: one more factor of 2",
        ),
        "N^2/m",
        "N",
    ),
    PaperEquation(
        "(9)",
        "w_f = 4 pi r / (k sqrt(M N d))",
        "w_f = 4 pi r / (k sqrt(M N) d) = 2 lambda r / (sqrt(M N) d)",
        ("dimension: m^1.5, not m; d belongs outside of the root",),
        "m^1.5",
        "m",
    ),
)


def paper_attenuation_eq3_printed(distance_m: float, constants: PaperConstants) -> float:
    """Return P/P0 of equation (3)."""
    return math.exp(-2.0 * constants.attenuation_np_m * distance_m)


def paper_attenuation_eq6(distance_m: float, constants: PaperConstants) -> float:
    """Return P/P0 of equation (6)."""
    return math.exp(-constants.attenuation_np_m * distance_m)


def paper_force_eq8_printed(
    pressure_peak_pa: float, side_m: float, constants: PaperConstants
) -> float:
    """Return F of equation (8) for a cube in which |p| is constant; its unit is N^2/m."""
    modulus = constants.density_kg_m3 * constants.sound_speed_m_s**2
    return constants.alpha / modulus * pressure_peak_pa**3 / 3.0 * side_m**3


def paper_force_eq8_corrected(
    pressure_peak_pa: float, side_m: float, constants: PaperConstants
) -> float:
    """Return alpha p_rms^2 / (rho c^2) over a square in which |p| is constant, in newtons."""
    modulus = constants.density_kg_m3 * constants.sound_speed_m_s**2
    return constants.alpha * 0.5 * pressure_peak_pa**2 / modulus * side_m**2


def paper_spot_eq9_printed(distance_m: float, count: int, constants: PaperConstants) -> float:
    """Return w_f of equation (9) for M N = *count*; its unit is m^1.5."""
    return (
        4.0 * math.pi * distance_m / (constants.wavenumber * math.sqrt(count * constants.pitch_m))
    )


def paper_spot_eq9_corrected(distance_m: float, count: int, constants: PaperConstants) -> float:
    """Return w_f = 2 lambda r / (sqrt(M N) d), in metres: null to null of a square aperture."""
    return (
        4.0 * math.pi * distance_m / (constants.wavenumber * math.sqrt(count) * constants.pitch_m)
    )
