"""The systems behind the paper, and the list of all presets.

A figure without a source at hand says so: "recollection".
"""

from __future__ import annotations

import math
from typing import Final

from haptogram.acoustics import AcousticModel, Medium, Transducer, TransducerArray
from haptogram.acoustics.model.boards.grids import autd_unit, autd_units
from haptogram.errors import ConfigurationError
from haptogram.objects.shapes import Hemisphere
from haptogram.published import boards, figures
from haptogram.settings.arguments import did_you_mean

_HOSHI: Final = "T. Hoshi et al., IEEE Trans. Haptics 3(3), 155-165 (2010), abstract"
_PAPER: Final = "Haptogram (2014)"
_PAPER_OBJECT: Final = Hemisphere(radius_m=0.050, center_m=(0.0, 0.0, 0.100))
_PAPER_WAVELENGTH_M: Final = 2.0 * math.pi / 730.603  # wavelength by the wave number that it prints
_BEHIND_SCREEN_M: Final = (0.0, 0.0, 0.220)  # 20 mm in front of a screen at 200 mm
_FOUR_POINTS: Final = (
    (-0.025, -0.025, 0.2),
    (-0.025, 0.025, 0.2),
    (0.025, -0.025, 0.2),
    (0.025, 0.025, 0.2),
)


def _preset_in_air(array: TransducerArray) -> AcousticModel:
    return AcousticModel(array, Medium.air(), Transducer())


TACTILE_DISPLAY: Final = figures.Preset(
    "tactile-display",
    "18 x 18 airborne tactile display, reference [16] of the paper",
    _HOSHI,
    "324 transducers: abstract; 10 mm pitch and 200 mm focal distance: recollection",
    lambda: _preset_in_air(TransducerArray.grid(18, 18)),
    (0.0, 0.0, 0.2),
    (
        figures.published_element_count("324", _HOSHI),
        figures.PublishedFigure(
            "force at the focus",
            figures.published_force_mn((0.0, 0.0, 0.2)),
            "16 mN",
            _HOSHI,
            "on a reflecting disc of 20 mm diameter",
        ),
        figures.PublishedFigure(
            "source strength for 16 mN",
            figures.published_strength_pa_m((0.0, 0.0, 0.2), 0.016),
            "-",
            "derived",
            f"default {Transducer().source_strength_pa_m:g}",
        ),
        figures.PublishedFigure(
            "diameter of the focus",
            figures.published_spot_mm((0.0, 0.0, 0.2), lambda spot: spot.null_to_null_m[0]),
            "20 mm",
            _HOSHI,
            "null to null",
        ),
        figures.PublishedFigure(
            "response at 1 kHz modulation",
            figures.published_sideband(1000.0),
            "'up to 1 kHz'",
            _HOSHI,
            "amplitude of a sideband; bandwidth of a common transducer",
        ),
    ),
)

TOUCH_SCREEN: Final = figures.Preset(
    "touch-screen",
    "contactless touch screen, reference [14] of the paper",
    _PAPER + ", section 2",
    "assumed: one 249-element unit 200 mm behind an acoustically transparent screen; "
    "no source for the arrangement at hand",
    lambda: _preset_in_air(autd_unit()),
    _BEHIND_SCREEN_M,
    (
        figures.PublishedFigure(
            "focus in front of the screen",
            figures.published_spot_mm(_BEHIND_SCREEN_M, lambda spot: spot.axial_peak_m, 20.0),
            "10 ... 30 mm",
            _PAPER,
            "pressure maximum for a target at 20 mm: diffraction pulls it in",
        ),
        figures.PublishedFigure(
            "width of the focus at -6 dB",
            figures.published_spot_mm(_BEHIND_SCREEN_M, lambda spot: spot.width_6db_m[0]),
        ),
        figures.PublishedFigure("force at the focus", figures.published_force_mn(_BEHIND_SCREEN_M)),
    ),
)

_HASEGAWA: Final = "K. Hasegawa, H. Shinoda, IEEE Trans. Haptics 11(3) (2018), abstract"
LARGE_APERTURE: Final = figures.Preset(
    "large-aperture",
    "four-unit large-aperture array, after reference [17] of the paper",
    _HASEGAWA,
    "'four-unit array': abstract; 2 x 2 units of 249 elements edge to edge: assumed",
    lambda: _preset_in_air(autd_units(2, 2)),
    (0.0, 0.0, 0.6),
    (
        figures.PublishedFigure(
            "force at 1 m",
            figures.published_force_mn((0.0, 0.0, 1.0)),
            "'perceivable' at 1 m",
            _HASEGAWA,
            "on a disc of 20 mm diameter",
        ),
        figures.PublishedFigure(
            "width of the focus at 1 m, -6 dB",
            figures.published_spot_mm((0.0, 0.0, 1.0), lambda spot: spot.width_6db_m[0]),
        ),
        figures.PublishedFigure("force at 0.6 m", figures.published_force_mn((0.0, 0.0, 0.6))),
    ),
)

MULTI_POINT: Final = figures.Preset(
    "multi-point",
    "UltraHaptics: 16 x 20 multi-point system, reference [18] of the paper",
    "T. Carter et al., UIST 2013, doi 10.1145/2501988.2502018",
    "16 x 20 elements at a pitch of 10 mm: recollection",
    lambda: _preset_in_air(TransducerArray.grid(16, 20)),
    (0.0, 0.0, 0.2),
    (
        figures.published_element_count("320 (16 x 20)", "recollection"),
        figures.PublishedFigure(
            "size of a focus",
            figures.published_spot_mm((0.0, 0.0, 0.2), lambda spot: spot.width_6db_m[0]),
            "8.6 mm (a wavelength)",
            "recollection",
            "-6 dB along x at 200 mm; the aperture sets it, not the wavelength alone",
        ),
        figures.PublishedFigure(
            "weakest of four foci",
            figures.published_several_foci_share(_FOUR_POINTS),
            "'multiple localised points'",
            "abstract",
            "pressure; naive superposition, 50 mm apart at 200 mm",
        ),
    ),
)

PAPER_ARRAY: Final = figures.Preset(
    "paper",
    "the paper's own 16 x 16 array",
    _PAPER + ", section 4.1",
    "16 x 16 housings of 10 mm side by side: section 4.1, which also says 180 x 180 mm",
    AcousticModel.default,
    (0.0, 0.0, 0.1),
    (
        figures.published_element_count("256 (16 x 16)", _PAPER),
        figures.PublishedFigure(
            "side of the array",
            figures.published_extent_mm(0),
            "180 mm",
            _PAPER,
            "16 x 10 mm is 160 mm",
        ),
        figures.PublishedFigure(
            "w_f at r = 100 mm, equation (9)",
            figures.Quantity(
                lambda _: 1e3 * 2.0 * _PAPER_WAVELENGTH_M * 0.1 / (math.sqrt(256) * 0.010), "mm"
            ),
            "1.075e-3 m^1.5 as printed",
            _PAPER,
            "as corrected",
        ),
        figures.PublishedFigure(
            "width of the focus, null to null",
            figures.published_spot_mm((0.0, 0.0, 0.1), lambda spot: spot.null_to_null_m[0]),
            remark="(9) is paraxial: too narrow this close",
        ),
        figures.PublishedFigure(
            "mean force over the hemisphere",
            figures.published_mean_force_mn(lambda: _PAPER_OBJECT.sample(0.010)),
            "3.5 ... 4 mN",
            _PAPER + ", Table 1 (128 elements)",
            "256 elements, disc of 20 mm diameter; the printed constants give no absolute value",
        ),
        figures.PublishedFigure(
            "mean pressure at the foci",
            figures.published_mean_pressure_kpa(lambda: _PAPER_OBJECT.sample(0.010)),
            "2.65 kPa for 200 foci",
            "G. Korres, M. Eid, IEEE Access 4, 7758 (2016), abstract",
            "our hemisphere has 175 foci; the prototype has other tiles",
        ),
    ),
)

PRESETS: Final = (
    PAPER_ARRAY,
    TACTILE_DISPLAY,
    TOUCH_SCREEN,
    LARGE_APERTURE,
    MULTI_POINT,
    boards.SONICSURFACE,
    boards.ULTRAINO,
    boards.FLAT8,
    boards.TINYLEV,
    boards.INTERACTLAB,
    boards.AUTD,
)


def find_preset(name: str) -> figures.Preset:
    """Return the preset of that name.

    Raises
    ------
    ConfigurationError
        If there is none; names those that there are.
    """
    for preset in PRESETS:
        if preset.name == name:
            return preset
    known = [preset.name for preset in PRESETS]
    guess = did_you_mean(name, known)
    raise ConfigurationError(f"preset is {name!r}; known are {', '.join(known)}{guess}")
