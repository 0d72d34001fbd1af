"""An engine's parameters in the form that the native engine takes."""

from __future__ import annotations

from typing import Literal

import numpy as np

from vfplan import _core
from vfplan.engine.parameters import ProxyParameters
from vfplan.errors import SettingError

Search = Literal["auto", "grid", "brute"]
MAX_ITERATIONS = 16  # of the robust rule, a tick


def iterations_of(value: int | None) -> int:
    """Iterations a tick; `None`: 16. Raises `SettingError` for what is no integer of at least 1."""
    if value is None:
        return MAX_ITERATIONS
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
        raise SettingError(f"max_iterations {value!r}: allowed is an integer of at least 1")
    return min(int(value), 10**6)


def native_parameters(
    parameters: ProxyParameters, iterations: int, search: str
) -> _core.Parameters:
    """The parameters as the native engine takes them; raises `SettingError` for another search."""
    if search not in Search.__args__:
        raise SettingError(f"search {search!r}: allowed are {', '.join(Search.__args__)}")
    p = _core.Parameters()
    p.contact_radius = parameters.contact_radius
    p.band = parameters.band
    p.point_radius = parameters.point_radius
    p.outer_radius = parameters.outer_radius
    p.gain = parameters.gain
    p.rule = getattr(_core.Rule, parameters.rule)
    p.search = getattr(_core.Search, search)
    p.max_iterations = iterations
    p.set_stiffness(parameters.stiffness)
    if parameters.ignore_axis is not None:
        p.set_ignore_axis(parameters.ignore_axis)
    return p
