"""An ideal gear with losses."""

from __future__ import annotations

from typing import TYPE_CHECKING

from engine.block import Block, flange, parameter

if TYPE_CHECKING:
    from engine.net import Net


class Gear(Block):
    """Gear: input angle = ratio * output angle, torque out = efficiency * ratio * torque in, J on the output shaft.

    ``ratio`` n is the reduction: the input turns n times while the output turns once, in the opposite sense if n < 0,
    as in a pair of external gears. Of the power that enters at the input the share ``efficiency`` eta arrives at the
    output, whichever way it flows; so an inertia Jm before the gear counts as eta n^2 Jm behind it (Jeq = eta_g Kg^2 Jm
    + gears [Gao X. n.d., text below eq. 11]). The loss is counted in the energy balance. A constant eta gains power
    when the load drives the motor, a weakness of the law.

    With efficiency = 1 the gear is lossless and eta is not in the equations, so it cannot be tuned afterwards. A lossy
    gear cannot lie in a closed loop of ties.
    """

    cut_after = ("output",)

    ratio = parameter("1", ..., "reduction n, input speed / output speed; negative if the gear reverses", nonzero=True)
    efficiency = parameter(
        "1", 1.0, "share eta of the power at the input that arrives at the output", gt=0, le=1, tolerance=0.1
    )
    inertia = parameter("kg.m2", 0.0, "moment of inertia J of the gear train, on the output shaft", ge=0, tolerance=0.1)

    input = flange("the fast shaft")
    output = flange("the slow shaft")

    def stamp(self, net: Net) -> None:
        lossy = self.values["efficiency"] != 1
        terms = {self.input: 1, self.output: -self.ratio}
        net.tie(terms, (self.input, self.output, self.efficiency) if lossy else None)
        net.inertia(self.output, self.inertia)
