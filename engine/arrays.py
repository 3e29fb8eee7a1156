"""xarray, which an extra of the package brings."""

from __future__ import annotations

from typing import Any

from engine.errors import ParameterError


def xarray() -> Any:
    """The library.

    Raises:
        ParameterError: it is not installed.
    """
    try:
        import xarray as library
    except ImportError:
        raise ParameterError("xarray is not installed", remedy="pip install xarray") from None
    return library
