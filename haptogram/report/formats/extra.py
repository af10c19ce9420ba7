"""The extra ``report``: the packages that draw pictures and fill in pages."""

from __future__ import annotations

import importlib.util

from haptogram.errors import missing_extra


def require_report_packages(result: str, *packages: str) -> None:
    """Raise unless *packages* are installed; call this before the work begins.

    Parameters
    ----------
    result : str
        What needs them, as the subject of the message in the plural.

    Raises
    ------
    ConfigurationError
        Names what is missing, and how to install it.
    """
    missing = [name for name in packages if importlib.util.find_spec(name) is None]
    if missing:
        raise missing_extra(f"{result} need {' and '.join(missing)}", "report")
