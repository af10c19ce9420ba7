"""Pictures of fields (needs the extra ``report``).

Axes in millimetres, a unit on every colour bar, the target and the peak marked.  The colour maps
keep their order for colour-blind readers and in grey print: cividis for magnitudes, twilight,
which closes on itself, for phases.
"""

from haptogram.report.figures.plane_picture import (
    PictureField,
    draw_plane_figure,
    field_on_plane,
    sample_picture_mean,
    sample_picture_plane,
)
from haptogram.report.figures.planes import PicturePlane
from haptogram.report.figures.quantities import QUANTITIES, figure_quantity_and_label
from haptogram.report.figures.style import check_picture_format, encode_figure, write_figure
