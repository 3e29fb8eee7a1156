"""Energy and geometry of one uniform link whose root moves in the plane.

The link's frame has its origin at the root and its x axis along the undeformed link. In it the root moves with the
velocity (u, v) and turns with w; the material point s lies at (s, y), y = sum Q_j(s) d_j, Q_j from a set of shapes
(`blocks.links.shape_sets`), and moves with (u - y w, v + s w + y'). With rho = m / L and the payload mp at the tip,

    T = 1/2 rho int [(u - y w)^2 + (v + s w + y')^2] ds + 1/2 mp [the same at s = L] + 1/2 Jh w^2

``nonlinear`` keeps the terms of y w; without it the inertia is that of the straight link. ``foreshortening`` puts the
point at s - 1/2 int_0^s y_s^2 and keeps what is of second order in d.
[Gao X. n.d., eq. 11; Mohan 2010, eq. 11], corrected (docs/errata.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from blocks.links.shape_sets import ShapeSet
from engine.ports import Expression

Vector = Sequence[Expression]


def _dot(weights: NDArray[np.float64], d: Vector) -> Expression:
    return sum((float(w) * a for w, a in zip(weights, d, strict=True)), 0.0)


def _form(matrix: NDArray[np.float64], a: Vector, b: Vector) -> Expression:
    return sum((a[i] * _dot(row, b) for i, row in enumerate(matrix)), 0.0)


@dataclass(frozen=True)
class Link:
    """A uniform link.

    Attributes:
        length, mass, payload, hub_inertia: L, m, mp, Jh.
        shapes: in which it bends; none for a rigid link.
        nonlinear, foreshortening: the terms kept, see above.
    """

    length: Expression
    mass: Expression
    payload: Expression
    hub_inertia: Expression
    shapes: ShapeSet
    nonlinear: bool
    foreshortening: bool

    def stiffness(self, rigidity: Expression) -> list[Expression]:
        """Modal stiffness K_j = EI int (d2 Q_j / ds2)^2 ds."""
        return [rigidity / self.length**3 * float(k) for k in self.shapes.stiffness]

    def modal_mass(self) -> list[Expression]:
        """Modal mass M_j = m + mp Q_j(L)^2."""
        return [self.mass + self.payload * float(q) ** 2 for q in self.shapes.tip]

    def tip(self, d: Vector) -> Expression:
        """Deflection y of the tip, or its rate for the rates of the amplitudes."""
        return _dot(self.shapes.tip, d)

    def slope(self, d: Vector) -> Expression:
        """Slope y_s of the tip."""
        return _dot(self.shapes.tip_slope, d) / self.length

    def root_curvature(self, d: Vector) -> Expression:
        """Second derivative of y at the root."""
        return _dot(self.shapes.root_curvature, d) / self.length**2

    def reach(self, d: Vector) -> Expression:
        """Where the tip lies along x."""
        if not self.foreshortening:
            return self.length
        return self.length - _form(self.shapes.end, d, d) / (2 * self.length)

    def tip_rates(self, d: Vector) -> tuple[list[Expression], list[Expression], list[Expression]]:
        """Derivatives of `slope`, `reach` and `tip` with respect to the amplitudes."""
        slopes = [float(q) / self.length for q in self.shapes.tip_slope]
        drawn = [-_dot(row, d) / self.length for row in self.shapes.end] if self.foreshortening else []
        return slopes, drawn, [float(q) for q in self.shapes.tip]

    def moments(self, d: Vector) -> tuple[Expression, Expression]:
        """First moments of the mass along and across the link, payload included."""
        along = self.length * (self.mass / 2 + self.payload)
        return along - self._drawn(d, d) / 2, self._first(d)

    def moment_slopes(self, d: Vector) -> list[tuple[Expression, Expression]]:
        """Derivatives of `moments` with respect to the amplitudes."""
        units = np.eye(len(self.shapes)).tolist()
        return [(-self._drawn(unit, d), self._first(unit)) for unit in units]

    def kinetic(self, u: Expression, v: Expression, w: Expression, d: Vector, rate: Vector) -> Expression:
        """T for the root's velocity (u, v), turning w, amplitudes and their rates."""
        spin = self.hub_inertia + self.length**2 * (self.mass / 3 + self.payload)
        along = self.length * (self.mass / 2 + self.payload)
        turning = self.length * (self.mass * _dot(self.shapes.first_moment, rate) + self.payload * self.tip(rate))
        energy = (self.mass + self.payload) * (u**2 + v**2) / 2 + spin * w**2 / 2 + along * v * w
        energy += v * self._first(rate) + w * turning + self._second(rate) / 2
        if self.nonlinear:
            energy += self._second(d) * w**2 / 2 - u * w * self._first(d)
        if self.foreshortening:
            beam, end = _form(self.shapes.stiffening, d, d), _form(self.shapes.end, d, d)
            energy -= (self.mass * beam + self.payload * end) * w**2 / 2
            energy -= v * w * self._drawn(d, d) / 2 + u * self._drawn(d, rate)
        return energy

    def _first(self, d: Vector) -> Expression:
        """The moment rho int y ds + mp y(L)."""
        return self.mass * _dot(self.shapes.area, d) + self.payload * self.tip(d)

    def _second(self, d: Vector) -> Expression:
        """The moment rho int y^2 ds + mp y(L)^2."""
        return self.mass * sum((a**2 for a in d), 0.0) + self.payload * self.tip(d) ** 2

    def _drawn(self, a: Vector, b: Vector) -> Expression:
        """Mass times the way by which bending draws it in: a' (rho int H ds + mp H(L)) b, H(s) = int_0^s Q_i' Q_j'."""
        if not self.foreshortening:
            return 0.0
        shapes = self.shapes
        return (self.mass * _form(shapes.drawn, a, b) + self.payload * _form(shapes.end, a, b)) / self.length
