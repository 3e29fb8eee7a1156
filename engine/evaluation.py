"""CasADi functions called with arrays.

A call through CasADi's own matrices converts each number of each argument: 80 us for the Jacobian of model B, which
takes 2 us to work out. Here the function reads and writes arrays where they lie. The numbers are the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


class _Places:
    """Arrays for one call at a time."""

    def __init__(self, function: Any) -> None:
        self._buffer, self.work = function.buffer()
        self.given = [np.zeros(function.numel_in(k)) for k in range(function.n_in())]
        self.result = np.zeros(function.nnz_out(0))
        for k, array in enumerate(self.given):
            if array.size:
                self._buffer.set_arg(k, array.data)
        if self.result.size:
            self._buffer.set_res(0, self.result.data)


class Evaluation:
    """The first result of a function, for arrays; several threads may call it at the same time.

    Args:
        function: a `casadi.Function` whose arguments are dense columns.
    """

    def __init__(self, function: Any) -> None:
        self._function = function
        rows, columns = function.sparsity_out(0).get_triplet()
        self._where = np.array(rows, dtype=np.intp), np.array(columns, dtype=np.intp)
        self._shape = function.size_out(0)
        self._free: list[_Places] = []

    def __reduce__(self) -> tuple[Any, ...]:
        return Evaluation, (self._function,)

    def __call__(self, *arguments: ArrayLike) -> NDArray[np.float64]:
        """The result, a new array of the function's shape.

        Args:
            *arguments: of as many numbers as the function's.
        """
        places = self._filled(arguments)
        places.work()
        made = np.zeros(self._shape)
        made[self._where] = places.result
        self._free.append(places)
        return made

    def along(self, rows: NDArray[np.float64], k: int, *arguments: ArrayLike) -> NDArray[np.float64]:
        """The result for each of several values of one argument, shape (rows, nonzeros), zeros left out.

        Args:
            rows: of argument ``k``, one a row.
            k: which argument.
            *arguments: as of a call; that of ``k`` counts for nothing.
        """
        places = self._filled(arguments)
        given, work, result = places.given[k], places.work, places.result
        made = np.empty((len(rows), result.size))
        for row, there in zip(rows, made, strict=True):
            given[:] = row
            work()
            there[:] = result
        self._free.append(places)
        return made

    def _filled(self, arguments: Sequence[ArrayLike]) -> _Places:
        """Places of this call's own, with its arguments."""
        try:
            places = self._free.pop()
        except IndexError:
            places = _Places(self._function)
        for array, argument in zip(places.given, arguments, strict=True):
            array[:] = argument if type(argument) is np.ndarray and argument.ndim == 1 else np.ravel(argument)
        return places
